"""Recording a real bus: a tap between an unmodified program and its adapter.

The loop's first duty is to pass bytes on; it decodes only while nothing waits on either side, and
so it does with a shadow, an emulated bus that gets the same instructions.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from busemu.ports.device import SerialDevice
from busemu.ports.pty import PtyPort
from busemu.ports.tap import Chunk, Tap
from busemu.tables import Robot
from busemu.wording import amount
from hal.access import Access

from .recording import Recorder, write
from .recording.metadata import of_robot, source_of
from .shadow import Shadow
from .wire_decoder import WireCounts, WireDecoder

#: The loop looks so often whether it shall end [s].
LOOK_S = 0.1
#: With a shadow the loop waits no longer than this [s], and the joints go on by as much at once.
SLICE_S = 0.001
#: What passes is told once in this time [s].
TELL_EVERY_S = 5.0


@dataclass(frozen=True, slots=True)
class Passing:
    """What passed a tap since it was last told, over ``seconds`` [s], and the totals."""

    seconds: float
    instructions: int
    lost: int
    total: WireCounts
    baud_rate: int  #: of the device [bit/s]

    def __str__(self) -> str:
        return (
            f"{self.instructions / self.seconds:6.0f} instructions/s, "
            f"{amount(self.lost, 'value')} lost, {amount(self.total.rows, 'row')}, "
            f"{amount(self.total.damaged, 'damaged packet')}, "
            f"{amount(self.total.noise_bytes, 'byte')} of noise, {self.baud_rate} baud"
        )


class TapRecorder:
    """A tap on the bus of ``robot``: ``port`` for the program, ``device`` behind it."""

    def __init__(
        self,
        robot: Robot,
        port: PtyPort,
        device: SerialDevice,
        shadow: Shadow | None = None,
    ) -> None:
        self.robot = robot
        self.rows = Recorder()
        self._shadow = shadow
        self._decoder = WireDecoder(robot.protocol, robot.tables, self._access)
        self._device = device
        self._source = source_of(device.path)  # a link may be gone at the end
        self._tap = Tap(port, device)
        self._told = (time.monotonic(), 0, 0)

    @property
    def counts(self) -> WireCounts:
        """What has passed so far."""
        return self._decoder.counts

    def run(
        self,
        stopped: Callable[[], bool],
        tell: Callable[[Passing], object],
        complain: Callable[[str], object],
    ) -> None:
        """Pass bytes on and decode them until ``stopped()``, asked ten times a second.

        ``tell`` is called every few seconds, ``complain`` with one line when the device does not
        take the program's baud rate. Raises :class:`~busemu.ports.device.DeviceLostError`; all that
        passed before is decoded then as well.
        """
        look_s = tell_s = 0.0
        refused = ""
        try:
            while True:
                if not self._tap.turn(self._patience_s()):
                    if self._tap.passed:
                        self._decode(self._tap.passed.popleft())
                    elif self._shadow is not None:
                        until_s = min(time.monotonic(), self._shadow.now_s + SLICE_S)
                        self._shadow.advance(until_s)
                now_s = time.monotonic()
                if now_s < look_s:
                    continue
                look_s = now_s + LOOK_S
                if stopped():
                    break
                self._tap.unlock()
                if self._tap.refused != refused:
                    refused = self._tap.refused
                    if refused:
                        complain(refused)
                if now_s >= tell_s:
                    if tell_s:
                        tell(self._passing(now_s))
                    tell_s = now_s + TELL_EVERY_S
        finally:
            while self._tap.passed:
                self._decode(self._tap.passed.popleft())
            self._decoder.finish()

    def save(self, path: Path, group: str) -> None:
        """Write what was decoded; raises as :func:`bench.recording.write` does."""
        metadata = of_robot(
            self.robot,
            name=path.stem,
            source=self._source,
            group=group,
            condition={},
            baud_rate=self._device.baud_rate(),
        )
        write(self.rows.recording(metadata), path)

    def _patience_s(self) -> float:
        """How long the loop may wait for bytes [s]."""
        if self._tap.passed:
            return 0.0
        if self._shadow is None:
            return LOOK_S
        return min(SLICE_S, max(0.0, self._shadow.now_s + SLICE_S - time.monotonic()))

    def _access(self, access: Access) -> None:
        self.rows(access)
        if self._shadow is not None:
            self._shadow.seen(access)

    def _decode(self, chunk: Chunk) -> None:
        if chunk.from_host and self._shadow is not None:
            self._shadow.sent(chunk.data, chunk.t_s, self._device.baud_rate())
        take = self._decoder.sent if chunk.from_host else self._decoder.received
        take(chunk.data, chunk.t_s)

    def _passing(self, now_s: float) -> Passing:
        before_s, instructions, lost = self._told
        counts = replace(self.counts)
        self._told = (now_s, counts.instructions, counts.lost)
        return Passing(
            now_s - before_s,
            counts.instructions - instructions,
            counts.lost - lost,
            counts,
            self._device.baud_rate(),
        )
