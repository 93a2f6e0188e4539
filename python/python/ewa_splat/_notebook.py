"""Opens the window program from Python."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from typing import Any

#: The window's program.
PROGRAM = "ewa-splat-view"


def view(things: Any, *options: str, wait: bool = False) -> subprocess.Popen[bytes]:
    """Open the window program on things, if it is installed.

    Parameters
    ----------
    things
        One thing or a list of them, as a `Renderer` accepts them. Things loaded from files are opened from these, all
        others as splats in a temporary file.
    *options
        Command-line options, such as ``"--lit"``.
    wait
        Whether to wait until the window is closed.

    Returns
    -------
    subprocess.Popen
        The window's process.

    Raises
    ------
    FileNotFoundError
        The program is neither on the path nor beside this interpreter.
    """
    from ._adapt import adapt
    from ._renderer import convert

    beside = os.path.join(os.path.dirname(sys.executable), PROGRAM)
    program = shutil.which(PROGRAM) or (beside if os.path.exists(beside) else None)
    if program is None:
        raise FileNotFoundError(f"{PROGRAM}: expected the window's program on the path, found none; cargo install {PROGRAM}")
    listed = things if isinstance(things, (list, tuple)) else [things]
    adapted = [thing if isinstance(thing, (str, os.PathLike)) else adapt(thing) for thing in listed]
    paths: list[str] = []
    for thing in adapted:
        if isinstance(thing, (str, os.PathLike)):
            paths.append(os.fspath(thing))
        elif thing.path is not None:
            paths.append(thing.path)
        else:
            # The file is kept until the process ends, because the window may read it at any time.
            folder = _folder()
            path = os.path.join(folder, f"thing-{len(os.listdir(folder))}.ply")
            convert(thing, path)
            paths.append(path)
    process = subprocess.Popen([program, *paths, *options])
    if wait:
        process.wait()
    return process


_kept: list[tempfile.TemporaryDirectory[str]] = []


def _folder() -> str:
    if not _kept:
        _kept.append(tempfile.TemporaryDirectory(prefix="ewa-splat-"))
    return _kept[0].name
