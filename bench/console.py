"""The console that tables are printed on."""

from rich.console import Console

WIDTH = 120  #: where nobody looks: in a pipe or a file


def for_tables() -> Console:
    """A console as wide as the terminal, or of :data:`WIDTH` where there is none."""
    found = Console()
    return found if found.is_terminal else Console(width=WIDTH)
