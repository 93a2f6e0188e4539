"""``python -m ewa_splat``: the command-line program."""

from ._program import main

main()
