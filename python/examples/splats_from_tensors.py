"""Splats of a radiance field from the tensors that a training ends with, torch's or NumPy's."""

import numpy as np
from _arguments import FIXTURES, arguments

import ewa_splat as es

size, out = arguments(__doc__)
# What a training wrote: logarithms of scales, opacities before the sigmoid.
with open(FIXTURES / "splats" / "scene.ply", "rb") as file:
    names = []
    while (line := file.readline().decode().split()) != ["end_header"]:
        if line[0] == "property":
            names.append(line[2])
    table = np.fromfile(file, np.dtype([(name, "<f4") for name in names]))


def columns(*wanted):
    return np.stack([table[name] for name in wanted], axis=1)


tensors = {
    "positions": columns("x", "y", "z"),
    "scales": np.exp(columns("scale_0", "scale_1", "scale_2")),
    "rotations": columns("rot_0", "rot_1", "rot_2", "rot_3"),
    "opacities": 1 / (1 + np.exp(-table["opacity"])),
    # Channel by channel in the file, coefficient by coefficient here.
    "harmonics": np.concatenate(
        [columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None], columns(*(f"f_rest_{i}" for i in range(45))).reshape(-1, 3, 15).transpose(0, 2, 1)],
        axis=1,
    ),
}  # fmt: skip
try:
    import torch
except ImportError:
    print("without torch: of NumPy's arrays")
else:
    tensors = {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in tensors.items()}

splats = es.Splats.from_arrays(**tensors)
es.Renderer(splats).render(size=size).save(out / "splats.png")
print(es.convert(splats, out / "splats.spz"))
