"""Writing a trace while the bus is served: notes at once, lines when there is time for them.

The format is that of :mod:`busemu.traceline`. Nothing here reads a clock: times come in.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import stat
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from ..trace import WireEvent, WireEventKind
from .traceline import START, Dropped, Header, Record, TraceError, is_trace

#: A reply that has not been handed over for so long [s] is written without that time: a collision
#: may have left nothing of it.
HANDED_LIMIT_S = 0.5
#: So many runs of bytes are written at once: it takes about 0.05 ms, less than a reply may wait.
BATCH = 16
#: So many runs wait to be written at most; more than that, and the oldest are dropped.
WAITING_LIMIT = 20_000
#: So many replies are on their way to the host at most.
UNREAD_LIMIT = 1000
#: A file that has had its time is given back to the disk in pieces of so much [bytes]: a whole one
#: of 32 MB takes ext4 3 ms, which a reply cannot wait.
PIECE = 1 << 18

#: What does not consist of bytes of the host, or not always.
_NOT_THE_HOSTS = (WireEventKind.COLLISION, WireEventKind.FAULT)


@dataclass(slots=True)
class _Note:
    """A run of bytes on the wire, and what is measured of it by and by [s]."""

    event: WireEvent
    read_s: float | None = None
    handed_s: float | None = None
    lost: bool = False


class WireLog:
    """Writes a trace in batches, whenever its owner has time for it: `flush` when nothing is due.

    FILE and FILE.1 together stay below `size_bytes`: when FILE is half as long it becomes FILE.1,
    and what was FILE.1 is gone. Lines are written whole, in one system call a batch, so whatever
    ends the process leaves a readable file; the last batch, not yet written, is lost.
    """

    def __init__(self, path: Path, header: Header, size_bytes: int) -> None:
        """Open the file and write its header; an existing trace is continued.

        Raises :class:`TraceError` where the file cannot be written, is something else than a trace,
        or the size is less than 64 KiB.
        """
        if size_bytes < 65536:
            raise TraceError("--trace-size: a trace takes 0.1 MB at least")
        self.path = path
        self.half_bytes = size_bytes // 2
        self._older = path.with_name(path.name + ".1")
        self._header = header
        self._waiting: deque[_Note] = deque()
        self._unread: deque[_Note] = deque(maxlen=UNREAD_LIMIT)  # replies on their way to the host
        self._stream = b""
        self._read: tuple[bytes, float] = (b"", 0.0)
        self._dropped = 0
        self._file = -1
        self._size = 0
        self._doomed = -1
        self._doomed_size = 0
        try:
            _check(path)
            _check(self._older)
            self._open()
        except OSError as error:
            raise TraceError(f"--trace {path}: {error.strerror}") from None

    def __len__(self) -> int:
        return len(self._waiting)

    # -- what is told, in the midst of a transaction: nothing but notes ------------------------

    def heard(self, data: bytes, now_s: float) -> None:
        """The host's bytes were taken from the port; the bus is told of them next."""
        self._read = (data, now_s)

    def on_wire(self, event: WireEvent) -> None:
        """A run of bytes on the wire, as the bus tells of it."""
        note = _Note(event)
        if event.kind is WireEventKind.STATUS:
            self._unread.append(note)
        elif event.kind not in _NOT_THE_HOSTS or event.data is self._read[0]:
            note.read_s = self._read[1]
        self._waiting.append(note)
        if len(self._waiting) > WAITING_LIMIT:
            self._waiting.popleft()
            self._dropped += 1

    def handed(self, data: bytes, now_s: float) -> None:
        """Reply bytes were handed to the host."""
        stream = self._stream + data
        unread = self._unread
        while note := next((each for each in unread if each.event.data in stream), None):
            _, _, stream = stream.partition(note.event.data)
            note.handed_s = now_s
            while (lost := unread.popleft()) is not note:
                lost.lost = True  # replies keep their order
        while unread and unread[0].event.end_s < now_s - HANDED_LIMIT_S:
            unread.popleft()
        self._stream = stream if unread else b""

    # -- what takes time ------------------------------------------------------------------------

    def flush(self, now_s: float, limit: int | None = BATCH) -> None:
        """Write what is complete by `now_s`, `limit` runs of bytes at most (None: all there are).

        Raises :class:`TraceError` where the disk takes no more.
        """
        lines = []
        if self._dropped:
            lines.append(Dropped(self._dropped).line())
            self._dropped = 0
        waiting = self._waiting
        while waiting and (limit is None or len(lines) < limit):
            note = waiting[0]
            due = note.event.kind is WireEventKind.STATUS and note.handed_s is None
            over = note.lost or limit is None or note.event.end_s <= now_s - HANDED_LIMIT_S
            if due and not over:
                break
            waiting.popleft()
            lines.append(Record(note.event, note.read_s, note.handed_s).line())
        if lines:
            self._shrink(self._doomed_size - PIECE)
            self._write("".join(lines).encode())

    def close(self) -> None:
        """Write all that waits and close the file."""
        self.flush(0.0, limit=None)
        os.close(self._file)

    def _write(self, data: bytes) -> None:
        try:
            if self._size + len(data) > self.half_bytes:
                self._rotate()
            written = os.write(self._file, data)
        except OSError as error:
            raise TraceError(f"--trace {self.path}: {error.strerror}") from None
        self._size += written
        if written < len(data):
            raise TraceError(f"--trace {self.path}: there is no more room for it")

    def _rotate(self) -> None:
        """Make FILE the older half, and begin a new one."""
        self._shrink(0)  # it has been given back long since, unless the files are tiny
        with contextlib.suppress(FileNotFoundError):
            self._doomed = os.open(self._older, os.O_WRONLY | os.O_CLOEXEC)
            self._doomed_size = os.fstat(self._doomed).st_size
            os.unlink(self._older)  # ext4 writes a file out at once that takes another's place
        os.rename(self.path, self._older)
        os.close(self._file)
        self._file = -1
        self._open()

    def _shrink(self, size: int) -> None:
        """Cut the file that has had its time to `size`; with nothing left of it, let it go."""
        if self._doomed >= 0:
            self._doomed_size = max(0, size)
            os.ftruncate(self._doomed, self._doomed_size)
            if not self._doomed_size:
                os.close(self._doomed)
                self._doomed = -1

    def _open(self) -> None:
        """Open or make the file, lock it, and write the header behind what is there."""
        self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise TraceError(f"--trace {self.path}: another server is writing it") from None
        self._size = os.fstat(self._file).st_size
        cut = self._size and os.pread(self._file, 1, self._size - 1) != b"\n"
        data = (b"\n" if cut else b"") + self._header.line().encode()
        self._size += os.write(self._file, data)


def _check(path: Path) -> None:
    """Raise TraceError if a file of that name is there and is no trace."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise TraceError(f"--trace {path}: it is no file; choose another path")
        with path.open("rb") as file:
            start = file.read(len(START))
    except FileNotFoundError:
        return
    if start and not is_trace(start):
        raise TraceError(f"--trace {path}: a file of that name is no trace; choose another path")
