"""The event table: its columns, their types, and bringing any table to them.

A table is a ``pyarrow.Table``. Texts are dictionary-encoded (a recording has millions of rows and
some dozen registers), times and values are float64 with NaN for "none".
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from .errors import RecordingError

TEXT = pa.dictionary(pa.int32(), pa.string())

#: columns every recording has, in their order in a file -> type
REQUIRED: Mapping[str, pa.DataType] = MappingProxyType(
    {
        "t_s": pa.float64(),
        "t_reply_s": pa.float64(),
        "servo_id": pa.int16(),
        "op": TEXT,
        "register": TEXT,
        "raw": pa.float64(),
    }
)
#: columns a recording may have
OPTIONAL: Mapping[str, pa.DataType] = MappingProxyType({"t_latch_s": pa.float64()})
KNOWN: Mapping[str, pa.DataType] = MappingProxyType({**REQUIRED, **OPTIONAL})

#: what to do about a bad cell
MEND = "correct the cell or take the row out"


def canonical(table: pa.Table, path: Path | None) -> pa.Table:
    """Return ``table`` with its known columns first, of one chunk and of the types above.

    Columns that the format does not know are kept behind them. Raises :class:`RecordingError` for a
    missing or doubled column, for a cell that is no number where one is needed, and for an empty
    ``servo_id``, ``op`` or ``register``.
    """
    names = table.column_names
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        raise RecordingError(path, missing_columns(missing, names))
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise RecordingError(path, f"column {', '.join(doubled)} is there twice: keep one of each")
    order = [name for name in KNOWN if name in names]
    order += [name for name in names if name not in KNOWN]
    columns = {name: _cast(table.column(name), name, path) for name in order}
    return pa.table(columns)


def missing_columns(missing: list[str], present: list[str]) -> str:
    """Tell the rule broken by a table without the columns ``missing``, and what to do."""
    found = ", ".join(present) if present else "none"
    return (
        f"missing column {', '.join(missing)} (found: {found}): the event table needs "
        f"{', '.join(REQUIRED)}, separated by commas, named in the first line"
    )


def numbers(table: pa.Table, name: str) -> NDArray[np.float64]:
    """Return a float column as an array, shape (rows,); shares the table's memory."""
    values: NDArray[np.float64] = _flat(table.column(name)).to_numpy(zero_copy_only=False)
    return values


def servo_ids(table: pa.Table) -> NDArray[np.int16]:
    """Return the column ``servo_id``, shape (rows,); shares the table's memory."""
    values: NDArray[np.int16] = _flat(table.column("servo_id")).to_numpy(zero_copy_only=False)
    return values


def texts(table: pa.Table, name: str) -> tuple[NDArray[np.int32], list[str]]:
    """Return a text column as (codes of shape (rows,), the texts the codes point at)."""
    encoded = _flat(table.column(name))
    return encoded.indices.to_numpy(zero_copy_only=False), encoded.dictionary.to_pylist()


def _flat(column: pa.ChunkedArray) -> pa.Array:
    return column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()


def _cast(column: pa.ChunkedArray, name: str, path: Path | None) -> pa.Array:
    kind = KNOWN.get(name)
    if kind is None:
        return _flat(column)
    try:
        flat = _encoded(column) if kind == TEXT else _flat(column.cast(kind))
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        what = {pa.int16(): "the ID of a servo", TEXT: "a text"}.get(kind, "a number")
        row, cell = _first_bad_cell(column, pa.string() if kind == TEXT else kind)
        rule = f"{name} {cell!r} is not {what}: {MEND}"
        raise RecordingError(path, rule, row) from None
    if flat.null_count and kind == pa.float64():
        return pc.fill_null(flat, float("nan"))
    if flat.null_count:
        row = int(np.argmax(flat.is_null().to_numpy(zero_copy_only=False))) + 1
        raise RecordingError(path, f"{name} is empty: every row needs one", row)
    return flat


def _encoded(column: pa.ChunkedArray) -> pa.DictionaryArray:
    """Encode texts so that each is in the dictionary once, in the order they first appear."""
    if not pa.types.is_dictionary(column.type):
        return _flat(column.cast(pa.string())).dictionary_encode()
    array = _flat(column.unify_dictionaries())
    if array.null_count or array.dictionary.null_count:
        return array.cast(pa.string()).dictionary_encode()
    names = array.dictionary.cast(pa.string()).to_pylist()
    codes: dict[str, int] = {}
    renumbered = np.zeros(len(names), dtype=np.int32)
    for code in pc.unique(array.indices).to_pylist():
        renumbered[code] = codes.setdefault(names[code], len(codes))
    return pa.DictionaryArray.from_arrays(
        pa.array(renumbered[array.indices.to_numpy()]), pa.array(codes, pa.string())
    )


def _first_bad_cell(column: pa.ChunkedArray, kind: pa.DataType) -> tuple[int | None, object]:
    """Find the first row (from 1) whose cell is not of ``kind``, and the cell."""
    for row, cell in enumerate(column, start=1):
        try:
            pa.array([cell.as_py()], column.type).cast(kind)
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            return row, cell.as_py()
    return None, column.type
