"""Threads, Ctrl-C, and the program in the wheel."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest
from conftest import FIXTURES, program

import ewa_splat as es

POSITIONS = np.random.default_rng(7).normal(size=(20_000, 3)).astype(np.float32)


def test_one_renderer_in_many_threads_draws_each_picture_whole():
    renderer = es.Renderer(es.Volume.from_points(POSITIONS, POSITIONS[:, 0]), backend="cpu")
    cameras = [es.Camera.fit(azimuth=40 * i) for i in range(6)]
    alone = [renderer.render(camera, (64, 48)).numpy() for camera in cameras]
    together: list[np.ndarray | None] = [None] * len(cameras)

    def draw(i: int) -> None:
        together[i] = renderer.render(cameras[i], (64, 48)).numpy()

    threads = [threading.Thread(target=draw, args=(i,)) for i in range(len(cameras))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one, other in zip(alone, together, strict=True):
        assert other is not None and np.array_equal(one, other)


def test_arrays_that_others_change_meanwhile_do_no_harm():
    places, is_done = POSITIONS.copy(), threading.Event()

    def change() -> None:
        while not is_done.is_set():
            places[:] = np.nan
            places[:] = POSITIONS

    thread = threading.Thread(target=change)
    thread.start()
    try:
        for _ in range(5):
            volume = es.Volume.from_points(places, places[:, 1], radius=0.1)
            try:
                es.Renderer(volume, backend="cpu").render(size=(32, 24))
            except ValueError as error:
                assert "not finite" in str(error)
    finally:
        is_done.set()
        thread.join()


def test_what_is_freed_while_it_is_used_is_used_to_its_end():
    volume = es.Volume.from_points(POSITIONS, POSITIONS[:, 0])
    renderer = es.Renderer(volume, backend="cpu")
    del volume
    gc.collect()
    image = renderer.render(size=(32, 24))
    del renderer
    gc.collect()
    assert image.numpy().shape == (24, 32, 4) and np.isfinite(image.numpy()).all()


def test_the_interpreter_goes_on_meanwhile():
    renderer = es.Renderer(es.Volume.from_points(POSITIONS, POSITIONS[:, 0]), backend="cpu")
    steps, is_done = 0, threading.Event()

    def draw() -> None:
        renderer.render(size=(256, 192))
        is_done.set()

    thread = threading.Thread(target=draw)
    thread.start()
    while not is_done.is_set():
        steps += 1
        time.sleep(0)
    thread.join()
    # Were the interpreter held there would be one.
    assert steps > 3


@pytest.mark.skipif(os.name == "nt", reason="signals of Unix")
@pytest.mark.parametrize("work", ["report", "render", "reference"])
def test_ctrl_c_ends_long_work(work):
    script = textwrap.dedent(
        """
        import sys, numpy as np, ewa_splat as es
        n = 6_000_000 if sys.argv[1] != "reference" else 4000
        random = np.random.default_rng(1)
        places = random.random((n, 3), np.float32)
        volume = es.Volume.from_points(places, places[:, 0])
        renderer = es.Renderer(volume, backend="cpu")
        print("begun", flush=True)
        try:
            if sys.argv[1] == "report":
                volume.report
            elif sys.argv[1] == "render":
                renderer.render(size=(64, 48))
            else:
                renderer.reference(size=(2000, 2000), error=1e-9)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
            if sys.argv[1] == "reference":
                # What was interrupted can be used again.
                renderer.render(size=(8, 6))
            sys.exit(7)
        """
    )
    process = subprocess.Popen([sys.executable, "-c", script, work], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=120)
    assert (process.returncode, out) == (7, "interrupted\n")


def test_the_wheel_carries_the_program(run, tmp_path):
    done = run("render", FIXTURES / "vase.obj", "--out", tmp_path / "vase.png", "--size", "48x36", "--count", 2000)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "vase.png").read_bytes().startswith(b"\x89PNG")
    assert run("--version").stdout.startswith("ewa-splat ")
    nothing = run("render", tmp_path / "nothing.vtu", "--out", tmp_path / "nothing.png")
    assert nothing.returncode == 1 and nothing.stderr.startswith("error: ") and len(nothing.stderr.splitlines()) == 1
    usage = run("render")
    assert usage.returncode == 2 and "Usage: ewa-splat render" in usage.stderr


@pytest.mark.skipif(os.name == "nt", reason="signals of Unix")
def test_ctrl_c_ends_the_program_and_nothing_half_written_is_left(tmp_path):
    words = [program(), "render", str(FIXTURES / "wake.xyz"), "--out", str(tmp_path / "a.npy")]
    words += ["--reference", "--tolerance", "1e-9", "--size", "2000x2000"]
    process = subprocess.Popen(words, stderr=subprocess.DEVNULL)
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) == -signal.SIGINT
    assert list(tmp_path.iterdir()) == []
