"""``python -m busemu``: the command line."""

from .cli import main

main()
