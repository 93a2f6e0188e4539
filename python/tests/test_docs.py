"""Docstrings and examples do what they say; types are those that are written."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import needs

import ewa_splat

HERE = Path(__file__).resolve().parents[1]
MODULES = sorted(
    f"ewa_splat.{module.name}"
    for module in pkgutil.iter_modules(ewa_splat.__path__)
    if module.name not in ("_core", "__main__", "widget")
)
EXAMPLES = sorted(path.name for path in (HERE / "examples").glob("[a-z]*.py"))


@pytest.mark.parametrize("name", ["ewa_splat", *MODULES])
def test_docstrings(name):
    found = doctest.testmod(importlib.import_module(name), optionflags=doctest.ELLIPSIS)
    assert found.failed == 0


def test_what_is_public_is_documented():
    for name in ewa_splat.__all__:
        thing = getattr(ewa_splat, name)
        assert thing.__doc__, name
        for own, member in vars(thing).items() if isinstance(thing, type) else ():
            is_public = not own.startswith("_") and (callable(member) or isinstance(member, (classmethod, property)))
            assert not is_public or member.__doc__ or issubclass(thing, tuple), f"{name}.{own}"


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples(name, tmp_path):
    needs("PIL")
    done = subprocess.run(
        [sys.executable, HERE / "examples" / name, "--size", "96x72", "--out", tmp_path],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert any(tmp_path.iterdir()), "an example writes what it shows"


def test_types():
    needs("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy"], cwd=HERE, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout


def test_importing_takes_nothing_that_is_not_needed():
    script = "import sys, ewa_splat; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    loaded = set(done.stdout.split())
    assert not loaded & {"PIL", "matplotlib", "vtk", "vtkmodules", "pyvista", "anywidget", "xarray", "yt", "typing_extensions"}
