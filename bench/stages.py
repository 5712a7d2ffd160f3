"""Telling the stages of something long: a moving line at a terminal, else a line each."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """Yield what is told each stage."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        start_s = time.monotonic()
        yield lambda stage: typer.echo(f"{time.monotonic() - start_s:6.0f} s  {stage}", err=True)
        return
    columns = SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("reading", total=None)
        yield lambda stage: bar.update(task, description=stage)
