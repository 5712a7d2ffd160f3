"""A bus in virtual time with faults, and the official SDK as its client."""

from __future__ import annotations

from typing import Any

from virtual_bus import OK, Bench

from busemu.chance import seeded
from busemu.faults import Faults, parse_fault
from busemu.ports.port import plug_of
from busemu.trace import WireEventKind


class FaultBench(Bench):
    """`have("drop", servo=3)` asks for a fault; `words` are what the trace says of them."""

    def __init__(self, *args: Any, seed: int = 1, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        self.faults = Faults(
            self.bus,
            self.robot,
            seeded(seed),
            plug_of(self.port),
        )

    def have(self, kind: str, **fields: Any) -> int:
        self.bus.advance_plant(self.now_s())
        number = self.faults.add(parse_fault({"kind": kind, **fields}, "test", self.robot))
        self.bus.poll(self.now_s())
        return number

    def look(self, servo_id: int = 1) -> tuple[int, int, int]:
        """One transaction; the SDK's ping is two in Protocol 1.0."""
        return self.read("id", servo_id)

    def get_anyway(self, name: str, servo_id: int = 1) -> int:
        """A register of a servo that holds an alarm."""
        value, result, _ = self.read(name, servo_id)
        assert result == OK
        return value

    def clear(self, which: Any = None) -> None:
        self.faults.clear(which)

    @property
    def words(self) -> list[str]:
        return [event.words for event in self.wire if event.kind is WireEventKind.FAULT]

    def replies(self) -> list[bytes]:
        return [event.data for event in self.wire if event.kind is WireEventKind.STATUS]
