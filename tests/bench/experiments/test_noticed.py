"""What was noticed in an experiment, put together."""

from __future__ import annotations

from typing import Any, cast

from bench.experiments.noticed import MOST_KINDS, noticed, told
from bench.recording import Recording


class Told:
    """A recording as far as it is asked here."""

    def __init__(self, name: str, *events: tuple[float, str, list[str]]) -> None:
        self.name = name
        self.metadata: dict[str, Any] = {}
        if events:
            self.metadata["noticed"] = [
                {"t_s": t_s, "what": what, "bodies": bodies, "note": ""}
                for t_s, what, bodies in events
            ]


def of(*recordings: Told) -> list[Recording]:
    return cast("list[Recording]", list(recordings))


PAIR = ["leg2.tibia", "leg6.tibia"]


def test_falls_come_first_and_what_happens_often_is_told_once() -> None:
    every = noticed(
        of(
            Told("a", (2.0, "self-contact", PAIR), (2.5, "self-contact", PAIR)),
            Told("b"),
            Told("c", (1.0, "self-contact", PAIR), (8.0, "fall", ["trunk"])),
        )
    )
    assert told(every) == [
        "noticed fall: trunk, at 8.00 s of c",
        "noticed self-contact: leg2.tibia and leg6.tibia, at 2.00 s of a; 3 times in 2 recordings",
    ]


def test_nothing_noticed_is_nothing_to_tell() -> None:
    assert told(noticed(of(Told("a"), Told("b")))) == []


def test_many_kinds_are_counted() -> None:
    many = [(1.0, "ground contact", [f"leg{i}.coxa"]) for i in range(MOST_KINDS + 2)]
    lines = told(noticed(of(Told("a", *many))))
    assert len(lines) == MOST_KINDS + 1
    assert lines[-1] == "noticed 2 more kinds: see result.json"
