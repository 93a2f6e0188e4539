"""The command-line program ``ewa-splat``, as an entry point of the package."""

from __future__ import annotations

import signal
import sys

from . import _core


def main() -> None:
    """Run the program with the words of the command line, and end the process."""
    # As in any other program Ctrl-C ends it at once.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _core.main(["ewa-splat", *sys.argv[1:]])
