"""Many walks, several at once in processes of their own.

Ctrl-C is the business of the process that started them: it tells the others to stop, they let go
of their walks within a control cycle, and what was finished is kept. A process whose starter is
gone, however that ended, ends too.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.synchronize import Event
from types import TracebackType

from ..starter import end_with_starter
from .candidate import GaitSearchError
from .outcome import Job, Outcome
from .walking import Check

Walk = Callable[[Job, Check], Outcome]


class _StoppedError(Exception):
    """Ends a walk that nobody waits for any more."""


_walk: Walk | None = None
_stop: Event | None = None


def _begin(walk: Walk, stop: Event, parent: int) -> None:
    """Make a process ready."""
    global _walk, _stop
    _walk, _stop = walk, stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the starter hears it, too, and tells us
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.SIG_DFL)

    end_with_starter(parent)


def _check() -> None:
    assert _stop is not None
    if _stop.is_set():
        raise _StoppedError


def _run(job: Job) -> Outcome:
    assert _walk is not None
    _check()
    return _walk(job, _check)


class Walks:
    """Makes walks with ``walk``, up to ``processes`` at once; one process is this one itself."""

    def __init__(self, walk: Walk, processes: int) -> None:
        self._walk = walk
        self._pool: ProcessPoolExecutor | None = None
        if processes > 1:
            context = multiprocessing.get_context("fork")  # a robot's mappings cannot be pickled
            self._stop = context.Event()
            self._pool = ProcessPoolExecutor(
                processes, context, _begin, (walk, self._stop, os.getpid())
            )

    def run(self, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """Outcomes as they come, in any order. Raises :class:`GaitSearchError`."""
        if self._pool is None:
            for job in jobs:
                yield self._walk(job, lambda: None)
            return
        futures: list[Future[Outcome]] = [self._pool.submit(_run, job) for job in jobs]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BrokenProcessPool:
            raise GaitSearchError(
                "a process that walked has died (out of memory?): the same command goes on, with "
                "fewer --processes if need be"
            ) from None

    def close(self) -> None:
        """End the processes; walks under way are given up."""
        if self._pool is not None:
            self._stop.set()
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def __enter__(self) -> Walks:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
