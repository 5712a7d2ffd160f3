"""Reading a trace: whole, or line by line while a server writes it.

A follower looks at the file whenever it is asked, and never waits. It goes on when the file has
become FILE.1 and a new one stands in its place, and when the server has started again.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from .traceline import START, Entry, Header, TraceError, is_trace, parse_line

#: A follower reads so much at once [bytes], so that it can be asked for other things in between.
CHUNK = 1 << 20
NO_TRACE = "{}: no trace: its first line is not that of busemu serve --trace"


def read_trace(path: Path) -> Iterator[Entry | None]:
    """The entries of a stored trace; None for each damaged line.

    An unfinished last line is passed over. Raises :class:`TraceError` if the file cannot be read or
    is no trace.
    """
    try:
        with path.open("rb") as file:
            if not is_trace(file.read(len(START))):
                raise TraceError(NO_TRACE.format(path))
            file.seek(0)
            yield from read_lines(file)
    except OSError as error:
        raise TraceError(f"{path}: {error.strerror}") from None


def read_lines(lines: Iterable[bytes]) -> Iterator[Entry | None]:
    """The entries that the lines of a trace mean, as :func:`read_trace` gives them."""
    for line in lines:
        if line.strip() and line.endswith(b"\n"):
            yield parse_line(line.decode("utf-8", "replace"))


class Follower:
    """Gives what a trace has gained since it was last asked.

    With `tail_bytes` it begins so many bytes before the end, and with the header that holds there;
    without, at the beginning. The file need not exist yet.
    """

    def __init__(self, path: Path, tail_bytes: int | None = None) -> None:
        self.path = path
        self.damaged = 0  #: lines that could not be read
        self._tail_bytes = tail_bytes
        self._file: BinaryIO | None = None
        self._rest = b""

    def poll(self) -> list[Entry]:
        """The entries that have come, oldest first; at most about a mebibyte of them.

        Raises :class:`TraceError` if the file cannot be read, or is no trace.
        """
        try:
            entries = self._begin() if self._file is None else []
            if self._file is None:
                return entries
            data = self._file.read(CHUNK)
            if not data and self._replaced():
                entries += self._lines(self._file.read())  # what came since the last look
                self.close()
                entries += self._begin()
                data = self._file.read(CHUNK) if self._file is not None else b""
            return entries + self._lines(data)
        except OSError as error:
            raise TraceError(f"{self.path}: {error.strerror}") from None

    def close(self) -> None:
        """Let go of the file; the next poll opens it again."""
        if self._file is not None:
            self._file.close()
        self._file = None

    def _begin(self) -> list[Entry]:
        """Open the file if it is there, and go to where reading begins."""
        try:
            file = self.path.open("rb")
        except FileNotFoundError:
            return []
        start = file.read(len(START))
        if not start:  # made and not yet written
            file.close()
            return []
        if not is_trace(start):
            file.close()
            raise TraceError(NO_TRACE.format(self.path))
        file.seek(0)
        self._file, self._rest = file, b""
        tail_bytes, self._tail_bytes = self._tail_bytes, None
        size = os.fstat(file.fileno()).st_size
        if tail_bytes is None or size <= tail_bytes:
            return []
        begin = size - tail_bytes
        header = _last_header(file.read(begin))
        file.readline()
        return [header] if header is not None else []

    def _lines(self, data: bytes) -> list[Entry]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        entries = [parse_line(line.decode("utf-8", "replace")) for line in lines if line.strip()]
        self.damaged += entries.count(None)
        return [entry for entry in entries if entry is not None]

    def _replaced(self) -> bool:
        """Whether another file has its name now, or it was cut; not while there is none."""
        assert self._file is not None
        with contextlib.suppress(FileNotFoundError):
            there, own = os.stat(self.path), os.fstat(self._file.fileno())
            return there.st_ino != own.st_ino or there.st_size < self._file.tell()
        return False


def _last_header(data: bytes) -> Header | None:
    at = data.rfind(b'{"format":')
    end = data.find(b"\n", at)
    header = parse_line(data[at : end if end >= 0 else None].decode("utf-8", "replace"))
    return header if isinstance(header, Header) else None
