"""The event table as Parquet, the metadata as TOML text in the file's schema."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from .errors import RecordingError

#: where the metadata is, among the schema's key-value metadata
KEY = b"busemu-recording"


def load(path: Path) -> tuple[pa.Table, bytes]:
    """Read a file: the table, the metadata as TOML text. Raises :class:`RecordingError`."""
    try:
        names = pq.read_schema(path).names
        encoded = [name for name in ("op", "register") if name in names]
        with pq.ParquetFile(path, read_dictionary=encoded) as file:
            table = file.read()
    except pa.ArrowInvalid as error:
        raise RecordingError(path, f"not a complete Parquet file: {error}") from None
    metadata = (table.schema.metadata or {}).get(KEY)
    if metadata is None:
        raise RecordingError(
            path,
            f"the schema's metadata has no key {KEY.decode()!r}: put the recording's metadata "
            "there as TOML text, or use a CSV file with a TOML file beside it",
        )
    return table, metadata


def save(table: pa.Table, metadata: str, file: BinaryIO) -> None:
    """Write ``table`` and ``metadata`` (TOML text) to an open file."""
    pq.write_table(
        table.replace_schema_metadata({KEY: metadata.encode()}), file, compression="zstd"
    )
