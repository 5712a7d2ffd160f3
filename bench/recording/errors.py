"""Why a recording is refused."""

from __future__ import annotations

from pathlib import Path


class RecordingError(ValueError):
    """A recording that cannot be used: says the file, the row, the rule and what to do.

    ``row`` counts the rows of the event table from 1, the header not counted; in a CSV file or a
    spreadsheet, which counts the header as line 1, it stands on line ``row + 1``. It is ``None``
    where the whole file or its metadata is at fault. ``path`` is ``None`` for a recording that has
    not been a file yet.
    """

    def __init__(self, path: Path | None, rule: str, row: int | None = None) -> None:
        self.path = path
        self.row = row
        self.rule = rule
        where = "recording in memory" if path is None else str(path)
        if row is not None:
            where += f": row {row}"
            if path is not None and path.suffix == ".csv":
                where += f" (line {row + 1} with the header)"
        super().__init__(f"{where}: {rule}")
