"""Splats as viewers of radiance fields show them: a renderer in numpy, by the rules of Kerbl et al. 2023."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from conftest import needs

DATA = Path(os.environ.get("EWA_DATA_DIR", Path(__file__).resolve().parents[3] / "shared" / "data"))


class Splats:
    """The splats of a PLY file in INRIA's layout."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        end = data.index(b"end_header\n") + len(b"end_header\n")
        lines = [line.split() for line in data[:end].decode().splitlines()]
        count = next(int(line[2]) for line in lines if line[:2] == ["element", "vertex"])
        kinds = {"float": "<f4", "uchar": "u1"}
        columns = np.dtype([(line[2], kinds[line[1]]) for line in lines if line[0] == "property"])
        table = np.frombuffer(data, columns, count, end)

        def of(*names: str) -> np.ndarray:
            return np.stack([table[name].astype(float) for name in names], 1)

        self.positions = of("x", "y", "z")
        scales = np.exp(of("scale_0", "scale_1", "scale_2"))
        w, x, y, z = (lambda q: (q / np.linalg.norm(q, axis=1, keepdims=True)).T)(of(*(f"rot_{i}" for i in range(4))))
        rows = [
            *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        ]
        axes = np.stack(rows, 1).reshape(-1, 3, 3) * scales[:, None, :]
        self.variances = axes @ axes.transpose(0, 2, 1)
        self.opacities = 1 / (1 + np.exp(-table["opacity"].astype(float)))
        rest = [f"f_rest_{i}" for i in range(sum(name.startswith("f_rest_") for name in columns.names))]
        # One channel after the other; the constant is first.
        constant = of("f_dc_0", "f_dc_1", "f_dc_2")[:, :, None]
        others = of(*rest).reshape(count, 3, -1) if rest else np.zeros((count, 3, 0))
        self.harmonics = np.concatenate([constant, others], 2)

    def colours(self, eye: np.ndarray) -> np.ndarray:
        """Codes as seen from the eye: real harmonics up to degree 3, in the order and with the signs of the format."""
        d = self.positions - eye
        x, y, z = (d / np.linalg.norm(d, axis=1, keepdims=True)).T
        xx, yy, zz = x * x, y * y, z * z
        one = np.full(len(x), 0.28209479177387814)
        basis = [one, *(0.4886025119029199 * a for a in (-y, z, -x))]
        basis += [1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (2 * zz - xx - yy)]
        basis += [-1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy)]
        basis += [-0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * x * y * z]
        basis += [-0.4570457994644658 * y * (4 * zz - xx - yy), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy)]
        basis += [-0.4570457994644658 * x * (4 * zz - xx - yy), 1.445305721320277 * z * (xx - yy)]
        basis += [-0.5900435899266435 * x * (xx - 3 * yy)]
        terms = self.harmonics.shape[2]
        return np.maximum(np.einsum("ncb,bn->nc", self.harmonics, np.stack(basis[:terms])) + 0.5, 0)

    def picture(
        self, eye, target, up, fov_deg, side, background, floor=1 / 255, ceiling=0.99, reach=4.0, compensates=False
    ) -> np.ndarray:
        """Codes of a square picture. The defaults are those of Kerbl et al., whose floor cuts before four deviations.

        - compensates: whether the filter is .1 px² wide and keeps opacity times area, as that of Yu et al. 2024.
        """
        eye = np.asarray(eye, float)
        forward = np.asarray(target, float) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        view = np.stack([right, np.cross(forward, right), forward])
        focal = 0.5 * side / math.tan(math.radians(fov_deg) / 2)
        x, y, z = ((self.positions - eye) @ view.T).T
        jacobians = np.zeros((len(z), 2, 3))
        most = 1.3 * math.tan(math.radians(fov_deg) / 2)
        jacobians[:, 0, 0] = jacobians[:, 1, 1] = focal / z
        jacobians[:, 0, 2] = -focal * np.clip(x / z, -most, most) / z
        jacobians[:, 1, 2] = -focal * np.clip(y / z, -most, most) / z
        rows = jacobians @ view
        bare = rows @ self.variances @ rows.transpose(0, 2, 1)
        footprints = bare + (0.1 if compensates else 0.3) * np.eye(2)
        opacities = self.opacities
        if compensates:
            opacities = opacities * np.sqrt(np.maximum(np.linalg.det(bare), 0) / np.linalg.det(footprints))
        centres = np.stack([focal * x / z, focal * y / z], 1) + side / 2
        colours = self.colours(eye)
        picture = np.zeros((side, side, 3))
        through = np.ones((side, side))
        for i in np.argsort(z, kind="stable"):
            if z[i] <= 0:
                continue
            radius = reach * math.sqrt(np.linalg.eigvalsh(footprints[i])[1])
            low = np.maximum(np.floor(centres[i] - radius), 0).astype(int)
            high = np.minimum(np.ceil(centres[i] + radius) + 1, side).astype(int)
            if (low >= high).any():
                continue
            window = (slice(low[1], high[1]), slice(low[0], high[0]))
            dx = np.arange(low[0], high[0]) + 0.5 - centres[i, 0]
            dy = np.arange(low[1], high[1])[:, None] + 0.5 - centres[i, 1]
            inverse = np.linalg.inv(footprints[i])
            q = inverse[0, 0] * dx * dx + 2 * inverse[0, 1] * dx * dy + inverse[1, 1] * dy * dy
            alpha = np.minimum(opacities[i] * np.exp(-0.5 * q), ceiling)
            alpha[(alpha < floor) | (q > reach * reach)] = 0
            picture[window] += (through[window] * alpha)[..., None] * colours[i]
            through[window] *= 1 - alpha
        return picture + through[..., None] * background


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return -10 * math.log10(np.mean((np.clip(a, 0, 1) - np.clip(b, 0, 1)) ** 2))


def codes(pixels: np.ndarray) -> np.ndarray:
    """sRGB codes of linear light."""
    low = pixels <= 0.0031308
    return np.where(low, 12.92 * pixels, 1.055 * np.maximum(pixels, 1e-9) ** (1 / 2.4) - 0.055)


VIEW = ("--fov", "40", "--size", "128x128", "--backend", "cpu", "--background", "0,0,0")


def drawn(run, tmp_path: Path, scene: Path, eye, target, up, *more: str) -> np.ndarray:
    out = tmp_path / "drawn.npy"
    places = [("--eye", eye), ("--target", target), ("--up", up)]
    words = [word for name, place in places for word in (name, ",".join(map(str, place)))]
    done = run("render", scene, "--out", out, *VIEW, *words, "--keep-axes", *more)
    assert done.returncode == 0, done.stderr
    return codes(np.load(out)[..., :3].astype(float))


def random_splats(path: Path, count: int) -> None:
    random = np.random.default_rng(5)
    names = [*"xyz", *(f"f_dc_{i}" for i in range(3)), "opacity", *(f"scale_{i}" for i in range(3))]
    names += [f"rot_{i}" for i in range(4)]
    table = np.concatenate(
        [
            random.uniform(-1, 1, (count, 3)),
            random.uniform(-1.7, 1.7, (count, 3)),
            random.normal(0, 1.5, (count, 1)),
            random.uniform(-4, -2, (count, 3)),
            random.normal(size=(count, 4)),
        ],
        1,
    )
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [*(f"property float {name}" for name in names), "end_header", ""]
    path.write_bytes("\n".join(header).encode() + table.astype("<f4").tobytes())


def test_splats_look_as_in_viewers(run, tmp_path) -> None:
    """More than 60 dB from the rules of viewers."""
    scene = tmp_path / "random.ply"
    random_splats(scene, 2000)
    eye, target, up = (0.5, -4, 0.8), (0, 0, 0), (0, 0, 1)
    splats = Splats(scene)

    def differ(rule: str, *more: str, **how) -> float:
        """dB between the program's picture and that in numpy."""
        ours = drawn(run, tmp_path, scene, eye, target, up, *(("--splat-rule", rule) if rule else ()), *more)
        return psnr(ours, splats.picture(eye, target, up, 40, 128, 0.0, **how))

    # The rule of the format is that of Kerbl et al.
    found = {
        "default": differ(""),
        "inria": differ("inria"),
        "mip": differ("mip", compensates=True),
        "khr": differ("khr", floor=0, ceiling=1, reach=3),
        "exact": differ("exact", floor=0, ceiling=1, reach=6),
    }
    print(found)
    assert all(dB > 60 for dB in found.values()), found
    # One rule differs from another.
    for rule, how in [("exact", {}), ("khr", {}), ("mip", {}), ("inria", {"floor": 0, "ceiling": 1, "reach": 3})]:
        assert differ(rule, **how) < 60, rule
    # Another order is another picture.
    assert differ("exact", "--order", "distance", floor=0, ceiling=1, reach=6) < 45


def test_real_splats_look_as_in_viewers(run, tmp_path) -> None:
    scene = DATA / "splats" / "fruit_drops_minimal.ply"
    if not scene.exists():
        assert not os.environ.get("EWA_REQUIRE_DATA"), f"{scene} is required"
        pytest.skip(f"{scene} is not there")
    splats = Splats(scene)
    low, high = np.percentile(splats.positions, [2, 98], axis=0)
    target = tuple(np.round(0.5 * (low + high), 3))
    eye = tuple(np.round(np.array(target) + np.array([0.3, -0.5, -2.0]) * np.linalg.norm(high - low), 3))
    ours = drawn(run, tmp_path, scene, eye, target, (0, -1, 0))
    assert np.ptp(ours) > 0.3, "the scene is in the picture"
    viewers = splats.picture(eye, target, (0, -1, 0), 40, 128, 0.0)
    exact = splats.picture(eye, target, (0, -1, 0), 40, 128, 0.0, floor=0, ceiling=1, reach=6)
    found = [psnr(ours, viewers), psnr(ours, exact)]
    print(found)
    assert found[0] > 60 and found[1] < 60


def checkered_square(folder: Path) -> Path:
    """A square from -1 to 1 in the plane z = 0, with a texture of 8 x 8 fields of 16 texels."""
    from PIL import Image

    fields = np.indices((8, 8)).sum(0) % 2
    texture = np.where(fields[..., None] == 1, [220, 40, 40], [240, 240, 60]).astype(np.uint8)
    Image.fromarray(texture.repeat(16, 0).repeat(16, 1)).save(folder / "fields.png")
    (folder / "square.mtl").write_text("newmtl m\nmap_Kd fields.png\n")
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    lines = ["mtllib square.mtl", "usemtl m"]
    lines += [f"v {x} {y} 0\nvt {(x + 1) / 2} {(y + 1) / 2}" for x, y in corners]
    lines += ["f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]
    (folder / "square.obj").write_text("\n".join(lines))
    return folder / "square.obj"


def test_converted_meshes_look_like_the_mesh(run, tmp_path) -> None:
    """A checkered square as 10,000 splats, in a viewer, against the square itself."""
    needs("PIL")
    square = checkered_square(tmp_path)
    out = tmp_path / "square.ply"
    done = run("convert", square, "--out", out, "--keep-axes", "--spacing", "0.02", "--json")
    assert done.returncode == 0, done.stderr
    splats = Splats(out)
    assert len(splats.positions) == 10_000
    side, distance = 256, 4.0
    seen = splats.picture((0, 0, distance), (0, 0, 0), (0, 1, 0), 40, side, 0.5)
    # The square itself, 4 x 4 samples to a pixel.
    across = (np.arange(4 * side) + 0.5) / (4 * side) * 2 - 1
    place = across * distance * math.tan(math.radians(20))
    field = np.floor((place + 1) * 4).astype(int)
    is_red = (field[None, :] + field[:, None]) % 2 == 1
    inside = (np.abs(place) < 1)[None, :] & (np.abs(place) < 1)[:, None]
    colours = np.where(is_red[..., None], np.array([220, 40, 40]) / 255, np.array([240, 240, 60]) / 255)
    truth = np.where(inside[..., None], colours, 0.5).reshape(side, 4, side, 4, 3).mean((1, 3))
    assert psnr(seen, truth) > 25.5
