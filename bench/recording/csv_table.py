"""The event table as CSV: commas, a header, points as decimal marks, ``nan`` for "none".

Numbers are written with as many digits as bring back the same float64.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

import pyarrow as pa
import pyarrow.csv

from .columns import KNOWN, MEND, REQUIRED, missing_columns, texts
from .errors import RecordingError

#: rows turned to text at a time when writing
ROWS_AT_ONCE = 1 << 18
#: cells that mean "no number"
EMPTY = ("", "nan", "NaN", "NAN")

_NUMBER: Mapping[pa.DataType, tuple[Callable[[str], object], str]] = MappingProxyType(
    {pa.float64(): (float, "a number"), pa.int16(): (int, "the ID of a servo")}
)


def load(path: Path) -> pa.Table:
    """Read the table in a file. Raises :class:`RecordingError` with the row of a bad cell."""
    try:
        return pyarrow.csv.read_csv(
            path,
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict(KNOWN), null_values=list(EMPTY), strings_can_be_null=False
            ),
        )
    except pa.ArrowInvalid as error:
        _explain(path)
        raise RecordingError(path, f"not a table: {error}") from None


def save(table: pa.Table, file: BinaryIO) -> None:
    """Write ``table`` to an open file."""
    text = pyarrow.csv.WriteOptions(
        include_header=False, quoting_style="none" if _simple(table) else "needed"
    )
    file.write((",".join(_cell(name) for name in table.column_names) + "\n").encode())
    plain = pa.schema(
        [
            pa.field(f.name, pa.string() if pa.types.is_dictionary(f.type) else f.type)
            for f in table.schema
        ]
    )
    for batch in table.to_batches(max_chunksize=ROWS_AT_ONCE):
        pyarrow.csv.write_csv(pa.Table.from_batches([batch]).cast(plain), file, text)


def _simple(table: pa.Table) -> bool:
    """Tell whether no cell needs quotes."""
    if any(table.schema.field(name).type == pa.string() for name in table.column_names):
        return False
    return all(_cell(text) == text for name in ("op", "register") for text in texts(table, name)[1])


def _cell(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if set(text) & set(',"\r\n') else text


def _explain(path: Path) -> None:
    """Find what Arrow could not read, cell by cell, and refuse it with its row."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows = csv.reader(file)
        header = next(rows, [])
        missing = [name for name in REQUIRED if name not in header]
        if missing:
            raise RecordingError(path, missing_columns(missing, header))
        for number, row in enumerate((row for row in rows if row), start=1):
            if len(row) != len(header):
                raise RecordingError(
                    path, f"{len(row)} cells under {len(header)} columns: mend the row", number
                )
            for name, cell in zip(header, row, strict=True):
                if (kind := KNOWN.get(name)) in _NUMBER and cell.strip() not in EMPTY:
                    convert, what = _NUMBER[kind]
                    try:
                        convert(cell)
                    except ValueError:
                        raise RecordingError(
                            path, f"{name} {cell!r} is not {what}: {MEND}", number
                        ) from None
