"""Files that are whole or not there: text, JSON, CSV, and any other.

All bytes go to a hidden file in the same folder first, ``.NAME.PID.part``; they are flushed to the
disk and take their name in one step. Until then a file of that name stays as it was. An error
leaves nothing behind; a process that is killed may leave its hidden file.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from busemu.state import sync_folder


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Give a file to fill; it takes the name ``path`` when the block ends without an error.

    Raises ``OSError`` with that name if the disk says no; then a file of that name is as it was.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as file:
            yield file
            flush(file)
        part.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(part)):
            error.filename = str(path)
        raise
    finally:
        part.unlink(missing_ok=True)


def flush(file: BinaryIO) -> None:
    """Bring what was written so far to the disk."""
    file.flush()
    os.fsync(file.fileno())


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, its line ends as they are. Raises ``OSError``."""
    with replacing(path) as file:
        file.write(text.encode())


def write_json(path: Path, document: Any) -> None:
    """Write a document as JSON; NumPy's numbers count as floats.

    Raises ``ValueError`` for a number that JSON lacks (see :func:`finite`), ``TypeError`` for what
    is no JSON, and ``OSError``.
    """
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False, default=float)
    write_text(path, text + "\n")


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table with a header, lines ending in one line feed. Raises ``OSError``."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows(rows)
    write_text(path, text.getvalue())


def finite(document: Any) -> Any:
    """A document without numbers that JSON lacks: NaN and infinity become ``None``."""
    if isinstance(document, Mapping):
        return {name: finite(value) for name, value in document.items()}
    if isinstance(document, (list, tuple)):
        return [finite(value) for value in document]
    if isinstance(document, float) and not math.isfinite(document):
        return None
    return document
