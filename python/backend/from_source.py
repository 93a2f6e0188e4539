"""Builds the package from source: says what that needs, and checks it before the compiler starts. maturin does the rest."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import maturin
from maturin import (  # noqa: F401: hooks that stay as they are
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
)

NEEDS = "a build from source needs Rust {rust} or newer, a linker, 4 GB of memory and some ten minutes on two processors"


def wanted() -> str:
    """Return the oldest Rust that compiles the package: that of its manifest."""
    manifest = Path(__file__).resolve().parents[1] / "Cargo.toml"
    found = re.search(r'^rust-version = "([0-9.]+)"', manifest.read_text(encoding="utf-8"), re.MULTILINE)
    return found.group(1) if found else "1.89"


def check() -> None:
    """Say what a build needs, and end it where that is missing."""
    rust = wanted()
    needs = NEEDS.format(rust=rust)
    print(f"ewa-splat: {needs}", file=sys.stderr, flush=True)
    advice = "update it (rustup update), or take a wheel: pip install --only-binary ewa-splat ewa-splat"
    compiler = shutil.which("rustc")
    if compiler is None:
        # maturin fetches one, or says why not.
        print("ewa-splat: found no Rust", file=sys.stderr, flush=True)
        return
    said = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False).stdout
    found = re.search(r"(\d+)\.(\d+)", said)
    if found and tuple(map(int, found.groups())) < tuple(map(int, rust.split(".")[:2])):
        raise SystemExit(f"ewa-splat: {needs}; found {said.strip()}: {advice}")


def build_wheel(*words: Any, **keywords: Any) -> str:
    check()
    return maturin.build_wheel(*words, **keywords)


def build_editable(*words: Any, **keywords: Any) -> str:
    check()
    return maturin.build_editable(*words, **keywords)


def prepare_metadata_for_build_wheel(*words: Any, **keywords: Any) -> str:
    check()
    return maturin.prepare_metadata_for_build_wheel(*words, **keywords)


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel
