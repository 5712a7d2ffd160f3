"""Foreign files as text, tables and JSON, with errors that say the file, the row and the rule."""

from __future__ import annotations

import codecs
import csv
import gzip
import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from bench.recording import RecordingError
from bench.recording.size import check_rows

Floats = NDArray[np.float64]

#: Largest foreign file that is read, uncompressed [bytes]; as an event table it takes up to some
#: twenty times as much memory, which is checked.
LARGEST_BYTES = 256 << 20
#: no log has a number larger than this in any unit: nanoseconds since 1970 are 1.8e18
LARGEST = 1e19
#: bytes that :func:`head` looks at
HEAD_BYTES = 1 << 16
#: cells that mean "no value"
EMPTY = frozenset({"", "nan", "NaN", "NAN", "null", "None"})


def is_gzip(path: Path) -> bool:
    """Whether a file's name says that it is compressed by gzip."""
    return path.suffix == ".gz"


def bare_name(path: Path) -> str:
    """The file's name without its suffixes: ``control`` of ``control.csv.gz``."""
    name = path.name.removesuffix(".gz")
    return name[: name.rfind(".")] if "." in name[1:] else name


def head(path: Path) -> str:
    """The first 64 KiB of a file as text; bytes that are no UTF-8 are replaced.

    Raises :class:`RecordingError` for a broken gzip file and ``OSError``.
    """
    return _read(path, HEAD_BYTES).decode("utf-8-sig", errors="replace")


def content(path: Path) -> bytes:
    """A whole file of UTF-8 text, unpacked, without a byte order mark.

    Raises :class:`RecordingError` for a file that is too large, broken or no text.
    """
    data = _read(path, LARGEST_BYTES + 1)
    if len(data) > LARGEST_BYTES:
        raise RecordingError(
            path,
            f"more than {LARGEST_BYTES >> 20} MiB of text: split it into parts, each with its own "
            "header, and import those",
        )
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise RecordingError(
            path, f"line {line} is not UTF-8 text (byte {error.start}): is this the right file?"
        ) from None
    return data.removeprefix(codecs.BOM_UTF8)


def json_object(path: Path) -> dict[str, Any]:
    """A JSON file whose outermost value is an object. Raises :class:`RecordingError`."""
    try:
        document = json.loads(content(path))
    except (json.JSONDecodeError, RecursionError, ValueError) as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(
            path, f"not JSON: {error}: is the file complete? Copy it once more"
        ) from None
    if not isinstance(document, dict):
        raise RecordingError(path, "the JSON holds no object at its top: {...} is needed")
    return document


@dataclass(frozen=True, eq=False)
class TextTable:
    """A CSV file, all cells still text: columns by name, rows counted from 1."""

    path: Path
    cells: pa.Table

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in the file's order."""
        return tuple(self.cells.column_names)

    def __len__(self) -> int:
        """Rows below the header."""
        return int(self.cells.num_rows)

    def require(self, *names: str) -> None:
        """Refuse a table that lacks one of these columns. Raises :class:`RecordingError`."""
        missing = [name for name in names if name not in self.names]
        if missing:
            found = ", ".join(self.names[:12]) + (", ..." if len(self.names) > 12 else "")
            raise RecordingError(
                self.path, f"column {', '.join(missing)} is missing (found: {found})"
            )

    def texts(self, name: str) -> list[str]:
        """A column as it stands."""
        self.require(name)
        found: list[str] = self.cells.column(name).to_pylist()
        return found

    def numbers(self, name: str) -> Floats:
        """A column as numbers, NaN where a cell is empty.

        Raises :class:`RecordingError` with the first row whose cell is no number.
        """
        self.require(name)
        column = self.cells.column(name)
        try:
            plain = pa.compute.replace_with_mask(
                column.combine_chunks(),
                pa.compute.is_in(column, pa.array(sorted(EMPTY))).combine_chunks(),
                pa.scalar("nan"),
            )
            values: Floats = plain.cast(pa.float64()).to_numpy(zero_copy_only=False)
        except pa.ArrowInvalid:
            values = np.array(
                [self._number(name, i, cell) for i, cell in enumerate(self.texts(name))]
            )
        return bounded(values, self.path, name)

    def times(self, name: str, scale_s: float) -> Floats:
        """A column of times, ``scale_s`` seconds a unit; every row needs one."""
        return checked_times(self.numbers(name) * scale_s, self.path, name)

    def _number(self, name: str, index: int, cell: str) -> float:
        try:
            return float("nan") if cell.strip() in EMPTY else float(cell)
        except ValueError:
            raise RecordingError(
                self.path,
                f"{name} {cell[:40]!r} is not a number: correct the cell or take the row out",
                index + 1,
            ) from None


def bounded(values: Floats, path: Path, name: str) -> Floats:
    """Give ``values`` back if none is beyond all that is measured. Raises as the others do."""
    wrong = np.flatnonzero(np.abs(values) > LARGEST)
    if wrong.size:
        row = int(wrong[0])
        raise RecordingError(path, f"{name} {values[row]:g} is nothing that was measured", row + 1)
    return values


def checked_times(times_s: Floats, path: Path, name: str) -> Floats:
    """Give ``times_s`` back if every row has one. Raises :class:`RecordingError`."""
    if (wrong := np.flatnonzero(~np.isfinite(times_s))).size:
        raise RecordingError(path, f"{name} is missing: every row needs a time", int(wrong[0]) + 1)
    return times_s


def csv_table(path: Path) -> TextTable:
    """Read a CSV file with a header, gzip or not, as text.

    Raises :class:`RecordingError` for no rows, a column that is there twice, and a row with more or
    fewer cells than the header.
    """
    data = content(path)
    bad: list[tuple[int | None, int, int]] = []

    def refuse(row: Any) -> str:
        bad.append((row.number, row.actual_columns, row.expected_columns))
        return "skip"

    names = header(data.split(b"\n", 1)[0].decode())
    if not names:
        raise RecordingError(path, "no header: the first line must name the columns")
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise RecordingError(path, f"column {doubled[0]!r} is there twice: keep one of each")
    check_rows(path, data.count(b"\n") * len(names))
    try:
        cells = pyarrow.csv.read_csv(
            pa.BufferReader(data),
            read_options=pyarrow.csv.ReadOptions(
                use_threads=False, column_names=names, skip_rows=1, block_size=16 << 20
            ),
            parse_options=pyarrow.csv.ParseOptions(
                invalid_row_handler=refuse, newlines_in_values=True
            ),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=False
            ),
        )
    except pa.ArrowInvalid as error:
        raise RecordingError(path, f"not a table: {error}") from None
    if bad:
        number, cells_there, wanted = bad[0]
        row = None if number is None else max(number - 1, 1)
        raise RecordingError(
            path, f"{cells_there} cells under {wanted} columns: mend the row or take it out", row
        )
    if cells.num_rows == 0:
        raise RecordingError(path, "no rows below the header: the log is empty")
    return TextTable(path, cells)


def header(line_text: str) -> list[str]:
    """Names of the columns that a CSV file's first line gives."""
    return [name.strip() for name in next(iter(_split(line_text.split("\n", 1)[0])), [])]


def _split(line: str) -> Iterator[list[str]]:
    try:
        yield from csv.reader([line.rstrip("\r\n")])
    except csv.Error:
        return


def _read(path: Path, largest: int) -> bytes:
    try:
        if not is_gzip(path):
            with path.open("rb") as file:
                return file.read(largest)
        with gzip.open(path, "rb") as packed:
            return packed.read(largest)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise RecordingError(
            path, f"not a complete gzip file: {error}: copy it once more"
        ) from None
