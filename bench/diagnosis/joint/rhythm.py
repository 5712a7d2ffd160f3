"""Load registers that are renewed now and then, oftener than they are read.

What such a register shows is the duty of a moment ago: its age goes up evenly and starts anew with
every period. Ages are short, but all of them keep one rhythm, and reads that are not quite even in
time see it at any frequency, much above their own rate (Lomb, 1976; Scargle, 1982). So periods are
proposed by the rhythm of what the register differs by from the firmware's law, over the slope of
the law; and each is judged by what a register would have shown that is renewed so, under the law
along the recorded angles, against one that is renewed in every tick of the firmware, and one that
is late by the same age at every read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.stepped import TICK_S

from ..noise import huber
from ..observed import Channel
from ..result import Cause, Estimate
from .confidence import NORMAL
from .fit import Fit
from .instants import believed_refresh_s
from .model import JointModel

Floats = NDArray[np.float64]

SHORTEST_S = 1.3 * TICK_S  #: a register that is renewed in every tick is always new
LONGEST_READS = 2.5  #: reads on end; longer periods are seen in the changes of the register
FINE_S = 0.05e-3  #: grid of instants: a phase is right to a twentieth of a tick
BACK_S = 0.003  #: over which the slope of the law is taken; assumed
FULL = 0.95  #: duty beyond which a law may be cut off, and tells nothing
CLIP = 5.0  #: deviations beyond which a difference counts as that
PROPOSED = 24  #: periods that are tried
PHASES = 24  #: of a period that are tried
NEARER = tuple(0.1 * k for k in range(-6, 7))  #: turns over a recording around the best of them
LINE = 2.0  #: frequencies nearer than this, in turns over a recording, are one rhythm
NEEDED = 50.0  #: gain [nats] of a period: what no difference of engines has
SHARE = 0.1  #: of all that the register differs by, which a period must explain
SECOND = 0.8  #: of that gain that any other period may have: else reads are too even to tell
CLOCK = 1e-4  #: assumed: how far clocks of servo and host may differ
JUMP = 8.0  #: steps of a register, or usual changes of it, that are no noise
OFTEN = 0.1  #: share of what jumps within a period that may jump again: reads are late by then
LEAST_READS = 100  #: of a register that changes


@dataclass(frozen=True, slots=True, eq=False)
class Register:
    """What one recording's load register showed, shape (n,), and the law over a grid of time."""

    t_s: Floats
    value: Floats
    duty: Floats  #: of the law, every FINE_S
    deviation: Floats  #: of the law along angles that are known now and then only
    quantum: float

    def off(self, age_s: Floats | float) -> Floats:
        """What it differs by from what it would show at some age, in deviations."""
        at = np.round((self.t_s - age_s) / FINE_S).astype(np.int64)
        off: Floats = (self.value - self.duty[np.maximum(at, 0)]) / self.deviation
        return off

    def late(self, longest_s: float) -> float:
        """Half the squares (Huber's) where its age is ever the same, the likeliest one [nats]."""
        ages = np.arange(0.0, longest_s, FINE_S)
        return min(float(huber(self.off(age)).sum()) for age in ages.tolist())

    def cost(self, period_s: float) -> float:
        """Half the squares (Huber's) with a period in the likeliest phase [nats]."""
        ages = (self.t_s - period_s * np.arange(PHASES)[:, None] / PHASES) % period_s
        at = np.maximum(np.round((self.t_s - ages) / FINE_S).astype(np.int64), 0)
        return float(huber((self.value - self.duty[at]) / self.deviation).sum(axis=1).min())


def short_refresh(model: JointModel, found: Fit) -> Cause | None:
    """A register with a period of its own, under about two reads; ``None`` where none is seen.

    Only where a servo's file takes every value for new. The gain [nats] is that over both others.
    """
    joint = model.observed[0].joint
    if believed_refresh_s(model.robot, joint) > 0.0:
        return None
    each = range(len(model.observed))
    seen = [one for r in each if (one := _register(model, found, r)) is not None]
    if not seen:
        return None
    longest_s = LONGEST_READS * max(float(np.median(np.diff(one.t_s))) for one in seen)
    span = math.sqrt(float(np.mean([np.ptp(one.t_s) ** 2 for one in seen])))
    always = sum(min(one.cost(TICK_S), one.late(longest_s)) for one in seen)

    def gain(period_s: float) -> float:
        return always - sum(one.cost(period_s) for one in seen)

    tried = {p: gain(p) for p in proposals(seen, longest_s)}
    best = max(tried, key=lambda p: tried[p], default=0.0)
    around = [best / (1.0 + off * best / span) for off in NEARER] if best else []
    tried |= {p: gain(p) for p in around}
    period = max(tried, key=lambda p: tried[p], default=0.0)
    rivals = [g for p, g in tried.items() if abs(1.0 / p - 1.0 / period) * span >= LINE]
    least = max(NEEDED, SHARE * always, max(rivals, default=0.0) / SECOND)
    if not tried or tried[period] < least or denied(seen, period):
        return None
    # the power of a line in a window falls with the square of pi f T, over 3
    off_hz = math.sqrt(1.5 / tried[period]) / (math.pi * span)
    half = NORMAL * period * math.hypot(period * off_hz, CLOCK)
    return Cause(
        effect="load_refresh",
        scope=(joint,),
        parameters={"period_s": Estimate(period, (period - half, period + half), "s")},
        held_out_gain_nats=float(tried[period]),
        explained_share=0.0,
        probability=1.0 - 1.0 / sum(len(one.t_s) for one in seen),
    )


def denied(seen: Sequence[Register], period_s: float) -> bool:
    """Whether registers jump twice within less than a period: then they are renewed oftener."""
    once, twice = 0, 0
    for one in seen:
        step = np.abs(np.diff(one.value))
        jump = step > JUMP * max(one.quantum, float(np.median(step)))
        near = one.t_s[2:] - one.t_s[:-2] < period_s
        once += int(np.sum(near & (jump[1:] | jump[:-1])))
        twice += int(np.sum(near & jump[1:] & jump[:-1]))
    return twice > OFTEN * once


def proposals(seen: Sequence[Register], longest_s: float) -> list[float]:
    """Periods [s] whose rhythm shows most in what registers differ by, each line once.

    Of a long one the second harmonic may show more: then that is meant, too.
    """
    span = max(float(one.t_s[-1]) for one in seen)
    count = 1 << math.ceil(math.log2(4.0 * span / FINE_S))
    hz = np.arange(int(count * FINE_S / SHORTEST_S)) / (count * FINE_S)
    nats = np.zeros(len(hz))
    for one in seen:
        off = np.clip(one.off(0.0), -CLIP, CLIP)
        slope = off - np.clip(one.off(BACK_S), -CLIP, CLIP)
        square = float(slope @ slope)
        if square <= 0.0:
            continue
        off = off - slope * float(slope @ off) / square
        row = np.zeros(count)
        np.add.at(row, np.round(one.t_s / FINE_S).astype(np.int64), slope * off)
        nats += np.abs(np.fft.rfft(row)[: len(hz)]) ** 2 / square
    nats[hz * longest_s < 1.0] = 0.0
    found: list[float] = []
    for _ in range(PROPOSED):
        k = int(np.argmax(nats))
        if nats[k] <= 0.0:
            break
        period_s = 1.0 / float(hz[k])
        found += [p for p in (period_s, 2.0 * period_s) if p < longest_s]
        nats[np.abs(hz - hz[k]) * span < LINE] = 0.0
    return found


def _register(model: JointModel, found: Fit, r: int) -> Register | None:
    samples = model.observed[r].channels.get(Channel.DUTY)
    if samples is None:
        return None
    duty = model.law(found.hypothesis, found.z, r, FINE_S)
    keep = samples.good & (np.abs(samples.value) < FULL)
    t_s, value = samples.t_s[keep], samples.value[keep]
    at = np.minimum(np.round(t_s / FINE_S).astype(np.int64), len(duty) - 1)
    off = value - duty[at]
    deviation = max(float(np.median(np.abs(off))) / 0.6745, samples.quantum)
    if len(t_s) < LEAST_READS:
        return None
    deviations = np.hypot(deviation, model.between(r, t_s))
    return Register(t_s, value, duty, deviations, samples.quantum)
