"""Builds a wheel: python python/wheel.py [--target TRIPLE] [--out FOLDER]

It needs Rust, pip, and nothing else: the build program and, for Linux, zig's linker come in an environment of its own below
the target folder. Wheels for Linux run wherever the C library is 2.28 or newer (manylinux_2_28), for Python 3.10 and newer.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--target", help="the processor and system, as Rust calls them; by default those of this machine")
    parser.add_argument("--out", type=Path, default=ROOT / "target" / "wheels", help="folder of the wheel")
    said = parser.parse_args()
    for_linux = "linux-gnu" in said.target if said.target else sys.platform == "linux"

    place = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / ("wheel-tools-zig" if for_linux else "wheel-tools")
    tools = place / ("Scripts" if os.name == "nt" else "bin")
    if not (tools / "maturin").exists() and not (tools / "maturin.exe").exists():
        venv.create(place, with_pip=True)
        maturin = "maturin[zig]>=1.9.4,<2" if for_linux else "maturin>=1.9.4,<2"
        subprocess.run([tools / "python", "-m", "pip", "install", "--quiet", maturin], check=True)

    words = [tools / "maturin", "build", "--release", "--locked", "--out", said.out.resolve()]
    words += ["--manifest-path", ROOT / "python" / "Cargo.toml"]
    if said.target:
        words += ["--target", said.target]
    if for_linux:
        words += ["--zig", "--compatibility", "manylinux_2_28"]
    # maturin looks for zig's package beside itself.
    paths = {"PATH": f"{tools}{os.pathsep}{os.environ['PATH']}", "VIRTUAL_ENV": str(place)}
    return subprocess.run(list(map(str, words)), env={**os.environ, **paths}, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
