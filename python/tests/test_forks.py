"""Processes that were forked after their parent had drawn."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import multiprocessing as mp, numpy as np, ewa_splat as es
volume = es.Volume.from_points(np.random.default_rng(1).normal(size=(500, 3)), smoothing_length=np.full(500, .3))
renderer = es.Renderer(volume, backend="cpu")
drawn = renderer.render(size=(50, 40)).numpy()

def again(k):
    own = es.Renderer(volume, backend="cpu" if k % 2 else "auto")
    return [es.Renderer.render(r, size=(50, 40)).numpy() for r in (own, renderer)]

def on_gpu(_):
    try:
        es.Renderer(volume, backend="gpu").render(size=(50, 40))
    except ValueError as error:
        return str(error)

if __name__ == "__main__":
    with mp.get_context("fork").Pool(2) as pool:
        for pictures in pool.map_async(again, range(4)).get(timeout=60):
            assert all(np.array_equal(picture, drawn) for picture in pictures)
        assert "spawn" in pool.map_async(on_gpu, [0]).get(timeout=60)[0]
    print("drawn")
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are forked on Linux")
def test_forked_processes_draw(tmp_path):
    path = tmp_path / "forks.py"
    path.write_text(PROGRAM)
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "drawn", done.stderr
