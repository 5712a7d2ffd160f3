"""What should not have happened in an experiment: falls, self-contacts, links on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from busemu.wording import amount
from sim.watch import What

from ..recording import Recording

#: Kinds that are told in words, the gravest first; all of them are in ``result.json``.
MOST_KINDS = 6
GRAVEST = tuple(what.value for what in What)


@dataclass(frozen=True, slots=True)
class Noticed:
    """One thing, such as two links that touch: when first [s], where, and how often in all."""

    what: str
    bodies: tuple[str, ...]
    note: str
    first_s: float
    recording: str
    times: int
    recordings: int

    def __str__(self) -> str:
        where = " and ".join(self.bodies)
        note = f", {self.note}" if self.note else ""
        found = f"{self.what}: {where}{note}, at {self.first_s:.2f} s of {self.recording}"
        if self.times > 1:
            found += f"; {self.times} times in {amount(self.recordings, 'recording')}"
        return found

    def numbers(self) -> dict[str, Any]:
        """As ``result.json`` has it."""
        return {
            "what": self.what,
            "bodies": list(self.bodies),
            "note": self.note,
            "first_t_s": self.first_s,
            "first_recording": self.recording,
            "times": self.times,
            "recordings": self.recordings,
        }


def noticed(recordings: Sequence[Recording]) -> tuple[Noticed, ...]:
    """What the recordings' metadata say was noticed, each kind once: falls first, then by time.

    Real robots have nobody beside them who would notice.
    """
    kinds: dict[tuple[str, ...], list[tuple[str, float, str]]] = {}
    for recording in recordings:
        for event in recording.metadata.get("noticed", ()):
            kind = (str(event["what"]), *map(str, event["bodies"]))
            found = recording.name, float(event["t_s"]), str(event["note"])
            kinds.setdefault(kind, []).append(found)
    every = [
        Noticed(
            what=what,
            bodies=tuple(bodies),
            note=found[0][2],
            first_s=found[0][1],
            recording=found[0][0],
            times=len(found),
            recordings=len({name for name, _, _ in found}),
        )
        for (what, *bodies), found in kinds.items()
    ]
    return tuple(sorted(every, key=lambda one: (GRAVEST.index(one.what), one.first_s)))


def told(every: Sequence[Noticed]) -> list[str]:
    """The gravest in words, and how many kinds more there are."""
    lines = [f"noticed {one}" for one in every[:MOST_KINDS]]
    if len(every) > MOST_KINDS:
        lines.append(f"noticed {len(every) - MOST_KINDS} more kinds: see result.json")
    return lines
