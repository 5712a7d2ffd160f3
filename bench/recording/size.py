"""Whether a recording's file fits into memory, before it is read."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from .errors import RecordingError

#: memory that reading and looking through a recording takes at its height [bytes a row];
#: measured: 90 from Parquet and 115 from CSV, for 5 million rows
BYTES_A_ROW = 150
#: bytes at the start of a CSV file that tell how long its rows are
SAMPLE_BYTES = 1 << 16
#: share of the free memory that a recording may take; assumed
SHARE = 0.8
MEMINFO = Path("/proc/meminfo")


def check_size(path: Path) -> None:
    """Refuse a file whose event table would not fit into the memory that is free.

    Nothing is refused where the system does not tell how much is free. Raises
    :class:`RecordingError`.
    """
    check_rows(path, _rows(path))


def check_rows(path: Path, rows: int) -> None:
    """Refuse so many rows of an event table if they would not fit; see :func:`check_size`."""
    free = free_bytes()
    if free is None or rows * BYTES_A_ROW <= SHARE * free:
        return
    raise RecordingError(
        path,
        f"about {rows:,} rows need {rows * BYTES_A_ROW / 2**30:.1f} GiB of memory, "
        f"{free / 2**30:.1f} GiB are free: split the recording by time, or record fewer registers",
    )


def free_bytes() -> int | None:
    """Memory that programs can still have [bytes]; ``None`` where the system does not say."""
    try:
        lines = MEMINFO.read_text("ascii").splitlines()
    except OSError:
        return None
    found = next((line for line in lines if line.startswith("MemAvailable:")), None)
    return None if found is None else int(found.split()[1]) * 1024


def _rows(path: Path) -> int:
    size = path.stat().st_size
    if path.suffix != ".parquet":
        with path.open("rb") as sample:
            beginning = sample.read(SAMPLE_BYTES)
        lines = max(beginning.count(b"\n"), 1)
        return size * lines // max(len(beginning), 1)
    try:
        with pq.ParquetFile(path) as file:
            return int(file.metadata.num_rows)
    except pa.ArrowException:
        return 0  # what it is instead is told when it is read
