"""What each channel of a robot's recordings judged, and what its search tried, for a report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..noise import Block, Noise
from .features import MEANS, RobotKind
from .fit import RobotFit
from .gains import RobotFindings, RobotGain
from .settling import RobotJudges

JUDGES = {
    RobotKind.JOINTS: "all joints",
    RobotKind.HEIGHT: "the trunk's height [m]",
    RobotKind.LEAN: "how the trunk leans about its mean [rad]",
    RobotKind.VOLTAGE: "the supply at the servos [V]",
    RobotKind.DUTY: "duties of joints that stand or move slowly",
}

#: why what a search had taken has no name in the end, where nothing else is said of it
LEFT_OUT = "taken at first, and not needed in the end"


def channels(
    held: RobotJudges, found: RobotFindings, after: RobotFit
) -> tuple[Mapping[str, Any], ...]:
    """What is left of each channel where it is fitted, as believed and after all that was found."""
    model, which = held.model, held.which
    rows = []
    for kind, floor in model.floors().items():
        if kind not in MEANS:
            continue
        values: list[float] = []
        own: list[Block] = []
        for one in (found.base, after):
            held.square(one, which)
            blocks = model.residuals(one.names, one.z, which)
            own = [block for (_, k), block in blocks.items() if k is kind]
            values.append(float(np.sqrt(np.mean(np.concatenate([b.value for b in own]) ** 2))))
        noise = after.noise.get(kind)
        over = "along their angles" if kind is RobotKind.DUTY else "over the phase of the gait"
        rows.append(
            {
                "channel": "position" if kind is RobotKind.JOINTS else kind.value,
                "judges": f"{JUDGES[kind]}, {over}",
                "rms_before": values[0],
                "rms_after": values[1],
                "rounding": floor,
                "noise": noise_of(own, noise) if noise else None,
            }
        )
    return tuple(rows)


def noise_of(blocks: Sequence[Block], noise: Noise) -> float:
    """Of rows of some blocks: what fits call noise, and what rows scatter by themselves."""
    scatter = np.mean(np.concatenate([block.scatter for block in blocks]))
    return float(np.hypot(noise.total, np.sqrt(scatter)))


def ranking(
    found: RobotFindings,
    whole: RobotFit,
    beside: Iterable[tuple[RobotGain, str]] = (),
    back: Mapping[str, str] | None = None,
) -> tuple[Mapping[str, Any], ...]:
    """What was tried in each step, with what it gained, and whether ``whole`` has it.

    ``beside`` is what something else than the gait has shown, with what that is: it is named, also
    where what it was fitted beside is no longer. ``back`` says why what a search had taken was
    taken back, by name.
    """
    rows = [_row(gain, whole, back or {}) for step in found.tried for gain in step]
    return (
        *rows,
        *(_row(gain, whole, {}) | {"named": True, "shown_by": by} for gain, by in beside),
    )


def _row(gain: RobotGain, whole: RobotFit, back: Mapping[str, str]) -> dict[str, Any]:
    named = set(gain.fit.names) <= set(whole.names)
    because = gain.because or back.get(gain.name, LEFT_OUT)
    row = {
        "effect": gain.name,
        "with": [n for n in gain.fit.names if n != gain.name],
        "gain_nats": float(gain.nats),
        "inflation": float(gain.inflation),
        "deflated_nats": float(gain.deflated),
        "held_out_nats": gain.held_out,
        "named": named,
    }
    return row if named else row | {"because": because}
