"""Splats that `convert` writes for OpenUSD, opened by its own library (`usd-core`)."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import FIXTURES, needs

needs("pxr.UsdValidation")

from pxr import Usd, UsdGeom, UsdValidation, UsdVol  # noqa: E402


def complaints(stage) -> list[str]:
    """What the library's validators say of a stage."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 20
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    return [f"{error.GetName()}: {error.GetMessage()}" for error in errors]


def table(text: str) -> dict[str, np.ndarray]:
    """The columns of a CSV file."""
    names, *rows = text.splitlines()
    return dict(zip(names.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))


@pytest.mark.parametrize("ending", ["usda", "usdc", "usdz"])
def test_written_splats_are_those_of_a_table(run, tmp_path, ending) -> None:
    scene = FIXTURES / "splats" / "scene.ply"
    out = tmp_path / f"a.{ending}"
    for file in (out, tmp_path / "a.csv"):
        done = run("convert", scene, "--out", file, "--keep-axes")
        assert done.returncode == 0, done.stderr
    stage = Usd.Stage.Open(str(out))
    prim = stage.GetDefaultPrim()
    assert prim.IsA(UsdVol.ParticleField3DGaussianSplat) and UsdGeom.GetStageUpAxis(stage) == "Y"
    splats = UsdVol.ParticleField3DGaussianSplat(prim)
    columns = table((tmp_path / "a.csv").read_text())
    count = len(columns["x"])

    def all_of(pattern: str, of: range) -> np.ndarray:
        return np.stack([columns[pattern.format(i)] for i in of], axis=-1)

    positions = np.stack([columns[axis] for axis in "xyz"], axis=-1)
    assert np.array_equal(np.array(splats.GetPositionsAttr().Get()), positions.astype("f4"))
    # The table has logarithms and logits in f32: some roundings.
    assert np.allclose(splats.GetScalesAttr().Get(), np.exp(all_of("scale_{}", range(3))), rtol=1e-6)
    assert np.allclose(splats.GetOpacitiesAttr().Get(), 1 / (1 + np.exp(-columns["opacity"])), atol=1e-6)
    turns = [[q.GetReal(), *q.GetImaginary()] for q in splats.GetOrientationsAttr().Get()]
    assert np.allclose(turns, all_of("rot_{}", range(4)), atol=1e-6)
    assert splats.GetRadianceSphericalHarmonicsDegreeAttr().Get() == 3
    sets = np.array(splats.GetRadianceSphericalHarmonicsCoefficientsAttr().Get()).reshape(count, 16, 3)
    assert np.array_equal(sets[:, 0], all_of("f_dc_{}", range(3)).astype("f4"))
    rest = all_of("f_rest_{}", range(45)).reshape(count, 3, 15).swapaxes(1, 2)
    assert np.array_equal(sets[:, 1:], rest.astype("f4"))
    assert Usd.ColorSpaceAPI(prim).GetColorSpaceNameAttr().Get() == "srgb_rec709_scene"
    low, high = np.array(splats.GetExtentAttr().Get())
    assert np.all(low < positions.min(0)) and np.all(high > positions.max(0))
    assert complaints(stage) == []


def test_surfels_are_surflets(run, tmp_path) -> None:
    out = tmp_path / "vase.usda"
    done = run("convert", FIXTURES / "vase.glb", "--count", "300", "--out", out)
    assert done.returncode == 0, done.stderr
    stage = Usd.Stage.Open(str(out))
    prim = stage.GetDefaultPrim()
    assert prim.GetTypeName() == "ParticleField"
    assert prim.HasAPI(UsdVol.ParticleFieldKernelGaussianSurfletAPI)
    assert len(prim.GetAttribute("positions").Get()) == 300
    assert complaints(stage) == []


def test_layers_of_the_library_are_read(run, tmp_path) -> None:
    flat = tmp_path / "flat.usdc"
    assert Usd.Stage.Open(str(FIXTURES / "usd" / "scene.usda")).Flatten().Export(str(flat))
    done = run("info", flat)
    assert done.returncode == 0 and "40" in done.stdout, done.stderr
