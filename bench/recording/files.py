"""Recordings as files: ``NAME.parquet``, or ``NAME.csv`` with ``NAME.toml`` beside it.

Writing never leaves half a file (:mod:`bench.files`). Of a pair the metadata takes its name before
the table, and a table that is to be replaced goes before both: at no instant does a table stand
beside missing or foreign metadata.
"""

from __future__ import annotations

import os
from pathlib import Path

from ..files import flush, replacing
from . import csv_table, parquet_table
from .errors import RecordingError
from .metadata import from_toml, to_toml
from .recording import Recording
from .size import check_size


def read(path: str | Path) -> Recording:
    """Read a recording: a ``.parquet`` file, or a ``.csv`` file with a ``.toml`` beside it.

    Either of the pair may be named. Raises :class:`RecordingError` with the file, the row and the
    rule if it is refused, and ``OSError`` if it cannot be read.
    """
    path = _known(Path(path))
    if path.suffix == ".parquet":
        check_size(path)
        table, text = parquet_table.load(path)
        return Recording.checked(table, from_toml(text, path), path)
    beside = path.with_suffix(".toml")
    path = path.with_suffix(".csv")
    for there, other in ((path, beside), (beside, path)):
        if not there.exists() and other.exists():
            raise RecordingError(
                other, f"{there.name} is missing beside it: a table and its metadata go together"
            )
    metadata = from_toml(beside.read_bytes(), beside)
    check_size(path)
    return Recording.checked(csv_table.load(path), metadata, path)


def write(recording: Recording, path: str | Path) -> Path:
    """Write ``recording`` as the encoding that the suffix names; ``.csv`` writes a ``.toml`` too.

    A file of that name is replaced. Returns the path of the table. Raises :class:`RecordingError`
    for another suffix and ``OSError`` if the disk says no; then nothing has changed.
    """
    path = _known(Path(path))
    text = to_toml(recording.metadata)
    if path.suffix == ".parquet":
        with replacing(path) as file:
            parquet_table.save(recording.table, text, file)
        return path
    beside = path.with_suffix(".toml")
    path = path.with_suffix(".csv")
    with replacing(path) as rows, replacing(beside) as metadata:  # named from the last to the first
        metadata.write(text.encode())
        csv_table.save(recording.table, rows)
        for file in (metadata, rows):
            flush(file)
        path.unlink(missing_ok=True)
    return path


def check_path(path: str | Path) -> Path:
    """Tell before a long run whether :func:`write` could write there; returns the path.

    Raises :class:`RecordingError` for a name without a known suffix or that a folder has, and for a
    folder that is missing or cannot be written to.
    """
    path = _known(Path(path))
    if not path.parent.is_dir():
        raise RecordingError(path, f"there is no folder {path.parent}: make it first")
    if not os.access(path.parent, os.W_OK):
        raise RecordingError(path, f"the folder {path.parent} cannot be written to: choose another")
    if path.is_dir():
        raise RecordingError(path, "a folder has that name: choose another")
    return path


def _known(path: Path) -> Path:
    if path.suffix not in (".parquet", ".csv", ".toml"):
        raise RecordingError(
            path, f"a recording's name ends in .parquet or .csv, not in {path.suffix!r}"
        )
    return path
