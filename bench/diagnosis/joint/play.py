"""Play that is seen in the data itself: a joint that is pushed, let go, and does not come back.

While a goal stands still and nothing else pushes, a joint stands still as well. Where it is moved
away from its goal all the same, something outside pushes. What it keeps when it is let go, on
either side, is the width in which nothing brings it back: play of the gear, or friction that holds
what the controller asks for near the goal. Angles of the output shaft and its duty cannot tell the
two apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..observed import Observed, held_at
from ..result import Cause, Estimate, Rival
from .confidence import NORMAL

Floats = NDArray[np.float64]

PLAY = "backlash"  #: the effect
STANDING_S = 0.25  #: for which a joint must stand still for a level to count; assumed
STANDING_COUNTS = 1.5  #: of the register that a joint at a standstill may move
BACK_COUNTS = 1.5  #: that a joint must come back when it is let go, or go when it is pushed
LEAST = 3  #: pushes to either side
ALIKE = ("coulomb_friction", "dead_zone")  #: what keeps a joint off its goal as well


@dataclass(frozen=True, slots=True)
class Play:
    """Widths between what a joint keeps after pushes to either side, and under them [rad]."""

    kept_rad: float
    kept_error_rad: float  #: standard error
    pushed_rad: float
    pushes: int

    @property
    def words(self) -> str:
        """What was seen, and what would tell its causes apart."""
        kept, pushed = np.degrees([self.kept_rad, self.pushed_rad])
        return (
            f"pushed to and fro while its goal stood still, the joint gives {pushed:.2f} deg and "
            f"keeps {kept:.2f} deg when it is let go: play that grows with load, or friction that "
            "holds it; turn it by hand with torque off: play gives way freely, friction resists"
        )


def play(observed: Sequence[Observed]) -> Play | None:
    """What pushes from outside show of a joint's play; ``None`` where nobody pushed."""
    kept: dict[bool, list[float]] = {True: [], False: []}
    pushed: dict[bool, list[float]] = {True: [], False: []}
    for one in observed:
        for out, back in _pushes(one):
            kept[out > 0.0].append(back)
            pushed[out > 0.0].append(out)
    if min(map(len, kept.values())) < LEAST:
        return None
    errors = [float(np.std(some, ddof=1) / np.sqrt(len(some))) for some in kept.values()]
    rounding = max(o.position.quantum for o in observed) / np.sqrt(12.0)
    return Play(
        float(np.mean(kept[True]) - np.mean(kept[False])),
        float(np.sqrt(sum(error**2 for error in errors) + rounding**2)),
        float(np.mean(pushed[True]) - np.mean(pushed[False])),
        sum(map(len, kept.values())),
    )


def play_cause(seen: Play, joint: str, deviation_rad: float) -> Cause:
    """Play as a cause, with what it is not told apart from.

    ``deviation_rad`` is that of an ordinary residual: the gain [nats] is what the pushes would cost
    if nothing kept the joint away from its goal.
    """
    half = NORMAL * seen.kept_error_rad
    ends = (max(0.0, seen.kept_rad - half), seen.kept_rad + half)
    share = 1.0 / (1.0 + len(ALIKE))
    return Cause(
        effect=PLAY,
        scope=(joint,),
        parameters={
            "width_rad": Estimate(seen.kept_rad, ends, "rad", f"trade-off with {ALIKE[0]}")
        },
        held_out_gain_nats=0.5 * seen.pushes * (0.5 * seen.kept_rad / deviation_rad) ** 2,
        explained_share=0.0,
        probability=share,
        indistinguishable_from=tuple(Rival(name, (joint,), share, 0.0) for name in ALIKE),
    )


def _pushes(one: Observed) -> Iterator[tuple[float, float]]:
    """Errors [rad] under each push, and after it, on the same side of the goal."""
    step = BACK_COUNTS * one.position.quantum
    for levels in _levels(one):
        for before, out, back in zip(levels, levels[1:], levels[2:], strict=False):
            side = np.sign(out)
            if side * before < side * out - step and 0.0 <= side * back < side * out - step:
                yield out, back


def _levels(one: Observed) -> Iterator[list[float]]:
    """For every goal that stands still: errors at which the joint stands still, in their order."""
    samples = one.position
    t, angles = samples.t_s[samples.good], samples.value[samples.good]
    goal = held_at(one.goal, t)
    error = angles - goal
    still = STANDING_COUNTS * samples.quantum
    for hold in np.split(np.arange(len(t)), np.flatnonzero(np.diff(goal) != 0.0) + 1):
        levels: list[float] = []
        begin = 0
        for k in range(1, len(hold) + 1):
            run = error[hold[begin:k]]
            if k < len(hold) and abs(error[hold[k]] - np.median(run)) <= still:
                continue
            if t[hold[k - 1]] - t[hold[begin]] >= STANDING_S:
                levels.append(float(np.median(run)))
            begin = k
        yield levels
