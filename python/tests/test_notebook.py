"""Notebooks and windows."""

from __future__ import annotations

import os
import stat

import numpy as np
import pytest
from conftest import FIXTURES, needs

import ewa_splat as es

POSITIONS = np.random.default_rng(7).normal(size=(200, 3))


def test_what_is_made_displays_itself():
    volume = es.Volume.from_points(POSITIONS, POSITIONS[:, 0])
    renderer = es.Renderer(volume, backend="cpu")
    for thing in (renderer, renderer.render(size=(32, 24))):
        assert thing._repr_png_().startswith(b"\x89PNG")
    assert "value" in repr(volume) and "Volume" in repr(renderer)


def test_the_widget_turns_and_refines():
    needs("anywidget")
    from ewa_splat.widget import Widget

    renderer = es.Renderer(es.Volume.from_points(POSITIONS, POSITIONS[:, 0]), backend="cpu")
    widget = Widget(renderer, size=(64, 48), transfer_function="plasma")
    told = []
    widget.send = told.append
    first = widget.png
    assert first.startswith(b"\x89PNG") and widget.width == 64
    widget._told(widget, {"turn": [50, -20]}, [])
    coarse = widget.png
    # Half as wide: the header of a PNG has its size.
    assert int.from_bytes(coarse[16:20], "big") == 32 and told == [{"drawn": True}]
    widget._told(widget, {"rest": True}, [])
    assert int.from_bytes(widget.png[16:20], "big") == 64 and widget.png != first
    widget._told(widget, {"zoom": 2.0}, [])
    widget._told(widget, {"rest": True}, [])
    expected = renderer.render(es.Camera.fit().orbit(-20, -8).zoomed(2.0), (64, 48)).png()
    assert widget.png == expected


@pytest.mark.skipif(os.name == "nt", reason="a script of Unix")
def test_view_opens_the_window_program(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="ewa-splat-view"):
        es.view(es.load(FIXTURES / "vase.obj"))
    script = tmp_path / "ewa-splat-view"
    script.write_text(f'#!/bin/sh\nfor word in "$@"; do echo "$word"; done > {tmp_path}/words\n')
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    volume = es.Volume.from_points(POSITIONS, color=(1, 0, 0), radius=0.1)
    process = es.view([es.load(FIXTURES / "vase.obj"), volume], "--lit", wait=True)
    assert process.returncode == 0
    file, splats, option = (tmp_path / "words").read_text().split()
    assert file.endswith("vase.obj") and option == "--lit"
    assert es.load(splats).report.samples == 200


def test_orbits_and_cameras():
    camera = es.Camera.look_at((0, -5, 0), (0, 0, 0))
    assert np.allclose(camera.orbit(90).eye, (5, 0, 0))
    assert np.allclose(camera.orbit(0, 90).eye, (0, 0, 5), atol=1e-12)
    assert np.allclose(camera.orbit(360, 0).eye, camera.eye)
    assert np.isclose(camera.zoomed(2).fov, 2 * np.degrees(np.arctan(np.tan(np.radians(17.5)) / 2)))
    with pytest.raises(ValueError, match="Image.camera"):
        es.Camera.fit().to_pyvista()
    image = es.Renderer(es.Volume.from_points(POSITIONS), backend="cpu").render(size=(32, 24))
    position, focal, up = (np.array(v) for v in image.camera.to_pyvista())
    assert np.isclose((focal - position) @ up, 0, atol=1e-12) and np.isclose(image.camera.fov, 35)


def test_files_of_pictures_and_of_splats(tmp_path):
    volume = es.Volume.from_points(POSITIONS, POSITIONS[:, 0])
    image = es.Renderer(volume, backend="cpu").render(size=(32, 24), depth=True, measure_error=True)
    assert image.depth.shape == (24, 32) and image.measured_error["percentile_999"] < 1 / 255
    for ending in ("npy", "exr"):
        image.save(tmp_path / f"a.{ending}")
        assert np.array_equal(es.Image.open(tmp_path / f"a.{ending}").numpy(), image.numpy())
    with pytest.raises(ValueError, match="png"):
        image.save(tmp_path / "a.jpg")
    with pytest.raises(ValueError, match="folder"):
        image.save(tmp_path / "no" / "a.png")
    assert not (tmp_path / "a.jpg").exists()
    written = es.convert(volume, tmp_path / "a.ply")
    assert written["splats"] > 0 and written["bytes"] == (tmp_path / "a.ply").stat().st_size
    assert es.compare(image, image)["psnr"] is None
    with pytest.raises(ValueError):
        es.compare(image, image.numpy()[:5])


def test_speed_against_accuracy_is_measured():
    few = es.Volume.from_points(POSITIONS[:20], POSITIONS[:20, 0])
    report = es.measure(few, size=(8, 6), frames=1, error=0.05)
    assert len(report["rows"]) > 10 and all(row["errors"]["rmse"] >= 0 for row in report["rows"])
