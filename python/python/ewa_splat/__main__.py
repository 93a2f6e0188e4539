"""Runs the command-line program: ``python -m ewa_splat``."""

from ._program import main

main()
