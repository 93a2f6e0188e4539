"""What tests share: the fixtures, and the program that the wheel carries."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

FIXTURES = Path(__file__).resolve().parents[2] / "fixtures"

#: Packages whose tests must not be skipped.
REQUIRED = os.environ.get("EWA_REQUIRE_PYTHON", "").split()


def needs(name: str):
    """A package, or a skipped test; an error where it is required."""
    if name in REQUIRED or "all" in REQUIRED:
        return __import__(name)
    return pytest.importorskip(name)


def program() -> str:
    """The entry point beside this interpreter."""
    beside = Path(sys.executable).parent / "ewa-splat"
    found = str(beside) if beside.exists() else shutil.which("ewa-splat")
    assert found, "the wheel carries the program ewa-splat"
    return found


@pytest.fixture(scope="session")
def run() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs the program."""

    def run(*words: object, **keywords: object) -> subprocess.CompletedProcess[str]:
        line = [program(), *map(str, words)]
        return subprocess.run(line, capture_output=True, text=True, timeout=300, **keywords)  # type: ignore[call-overload]

    return run


@pytest.fixture
def rendered(run, tmp_path) -> Callable[..., np.ndarray]:
    """What the program draws with one kernel per sample, as the package does."""

    def rendered(*words: object) -> np.ndarray:
        out = tmp_path / "program.npy"
        one = () if "--column-density" in words else ("--refine", "off")
        done = run("render", *words, *one, "--out", out, "--backend", "cpu", "--size", "96x72")
        assert done.returncode == 0, done.stderr
        return np.load(out)

    return rendered
