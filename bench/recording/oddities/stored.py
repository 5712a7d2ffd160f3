"""Registers that the emulated servo keeps and does nothing with, where they are not as sold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..recording import Recording
from .channel import Channel, at
from .oddity import Oddity, Weight

KIND = "without_effect"
WHY = "a real servo may move otherwise with it; the emulated one keeps the register, no more"
ADVICE = "record with the factory's value, or heed it where a model is not enough"


def check(recording: Recording) -> Iterator[Oddity]:
    """Those that the metadata tell."""
    servos = recording.metadata.get("servo", {})
    for servo_id, table in sorted(recording.models.items()):
        for name, raw in servos.get(str(servo_id), {}).get("registers", {}).items():
            if name in table and table[name].stored and raw != table[name].initial:
                what = _what(int(raw), table[name].initial)
                yield Oddity(KIND, Weight.NOTE, what, WHY, ADVICE, servo_id, name)


def check_channel(series: Channel) -> Iterator[Oddity]:
    """Those that rows tell, written or read."""
    register = series.register
    if register is None or not register.stored:
        return
    places = np.flatnonzero(~np.isnan(series.raw) & (series.raw != register.initial))
    if places.size:
        what = _what(int(series.raw[places[0]]), register.initial)
        yield at(series, places, KIND, Weight.NOTE, what, WHY, ADVICE)


def _what(raw: int, initial: int | None) -> str:
    return f"it is {raw}, not {initial} as from the factory, and no model here follows it"
