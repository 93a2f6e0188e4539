"""What all examples ask."""

from __future__ import annotations

import argparse
from pathlib import Path

FIXTURES = Path(__file__).resolve().parents[2] / "fixtures"


def arguments(purpose: str) -> tuple[tuple[int, int], Path]:
    """The size of pictures and the folder that they are written to."""
    parser = argparse.ArgumentParser(description=purpose)
    parser.add_argument("--size", default="800x600", help="width and height in pixels")
    parser.add_argument("--out", type=Path, default=Path(), help="folder for what is written")
    said = parser.parse_args()
    width, height = map(int, said.size.split("x"))
    said.out.mkdir(parents=True, exist_ok=True)
    return (width, height), said.out
