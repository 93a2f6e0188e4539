"""Runs the command-line program ``ewa-splat``, an entry point of the package."""

from __future__ import annotations

import signal
import sys

from . import _core


def main() -> None:
    """Run the program with the command line's arguments, and end the process."""
    # Ctrl-C ends the program at once, as in any other program.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _core.main(["ewa-splat", *sys.argv[1:]])
