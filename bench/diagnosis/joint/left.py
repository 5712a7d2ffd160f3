"""What rollouts leave of one recording: recorded less modelled, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.drive import fields, lanes

from ..noise import Block
from ..observed import Channel, Observed, Samples, held_at

Floats = NDArray[np.float64]

RAIL_S = 0.003  #: assumed: how late a voltage register is behind the current
#: over which voltages are averaged: a register is measured now and then, and shows that until the
#: next time; nobody documents when, and a current's step at another instant than it was looks like
#: noise; assumed
WINDOW_S = 0.05
WILD = 1e3  #: residuals beyond it, and those that are no numbers, count as so large
INSTANT_S = 0.0005  #: assumed deviation of a sample's instant; what a host's clock and a bus leave
DUTY_S = 0.002  #: the same of a duty, which is made of angles sampled, too
#: between a goal that is in force and a duty that is made of it: a tick of the controller, mostly
#: a millisecond, whose phase nobody knows, and what a host's clock leaves; assumed
TICK_S = 0.0015
FEWEST = 5  #: samples that are a block
REMEMBERED = 100  #: delays of goals; a fit turns few


class Left:
    """A recording, beside which rollouts of it are laid, several at once.

    ``renewed`` says whether the register of the duty is made anew in a period of its own, nobody
    knows when; ``made_s`` how sure its instants are [s], and ``rail_s`` those of the voltage's,
    if that is made in a period of its own.
    """

    def __init__(
        self,
        observed: Observed,
        *,
        renewed: bool,
        made_s: float = 0.0,
        rail_s: float | None = None,
    ) -> None:
        self._observed, self._renewed = observed, renewed
        self._made_s = math.hypot(DUTY_S, made_s)
        self._rail_s = rail_s
        self._speed = speed(observed)
        start = observed.replay.start
        self._gain = float(max(start[fields.GAIN_CW], start[fields.GAIN_CCW]))
        self._told = not made_s  #: whether no goal that came after it is in a duty
        self._either_s = max(TICK_S, made_s)
        self._changes: dict[float, Floats] = {}

    def blocks(
        self,
        channel: Channel,
        outs: Floats,
        duties: Floats | None,
        source_ohm: Floats,
        voltage_v: Floats,
        delay_s: Floats,
    ) -> list[Block]:
        """A block for every rollout; none where the channel was not recorded, or hardly.

        ``outs`` (rollouts, samples, CHANNELS) and ``duties`` (rollouts, samples) are of the
        replay's samples, the latter what a controller makes of the recorded angles; ``source_ohm``
        and ``voltage_v`` (rollouts,) are the supply's, ``delay_s`` (rollouts,) is the goal's.
        """
        samples = self._observed.channels.get(channel)
        if samples is None:
            return []
        keep = samples.good
        if channel is Channel.DUTY and self._renewed:
            # a new value was made at some time since the read before
            keep = keep & np.concatenate([[False], np.diff(samples.value) != 0.0])
        if keep.sum() < FEWEST:
            return []
        at = samples.index
        if channel is Channel.POSITION:
            modelled = outs[:, at, lanes.OUT_POSITION]
            extra = np.broadcast_to((self._speed[at] * INSTANT_S) ** 2, modelled.shape)
        elif channel is Channel.DUTY:
            assert duties is not None
            steps = np.stack([self._steps(float(late_s)) for late_s in delay_s])
            modelled, extra = self._duty(at, outs[:, at, lanes.OUT_DUTY], duties[:, at], steps)
        else:
            drawn = outs[:, :, lanes.OUT_DUTY] * outs[:, :, lanes.OUT_CURRENT]
            drop, extra = self._drop(samples, source_ohm[:, None] * drawn)
            modelled = voltage_v[:, None] - drop
        value = np.clip((samples.value - modelled)[:, keep], -WILD, WILD)
        value[np.isnan(value)] = WILD
        extra = np.nan_to_num(extra[:, keep], nan=0.0, posinf=0.0)
        t_s = samples.t_s[keep]
        if channel is Channel.VOLTAGE:
            t_s, value, extra = averaged(t_s, value, extra, WINDOW_S)
        return [Block(t_s, *row) for row in zip(value, extra, strict=True)]

    def between(self, t_s: Floats) -> Floats:
        """How far a duty may be off, at some instants, as angles are known now and then only.

        Between two reads a joint is taken to move evenly; it is an eighth of what its way is bent
        by, from read to read, off that.
        """
        angles, position = good(self._observed), self._observed.position
        bent = np.abs(np.diff(angles, 2, prepend=angles[:1], append=angles[-1:])) / 8.0
        around = np.maximum(bent, np.maximum(np.append(bent[1:], 0.0), np.append(0.0, bent[:-1])))
        off: Floats = self._gain * np.interp(t_s, position.t_s[position.good], around)
        return off

    def _duty(
        self, at: NDArray[np.int64], moved: Floats, duty: Floats, steps: Floats
    ) -> tuple[Floats, Floats]:
        modelled, aged = duty, np.zeros_like(duty)
        if self._renewed:
            earlier = np.concatenate([modelled[:, :1], modelled[:, :-1]], axis=1)
            modelled, aged = 0.5 * (modelled + earlier), (modelled - earlier) ** 2 / 12.0
        slope = self._gain * (np.abs(moved) < 1.0)
        extra = (slope * self._speed[at] * self._made_s) ** 2
        extra += (slope * self._observed.position.quantum) ** 2 / 6.0 + aged
        extra += steps**2 / (12.0 if self._renewed else 4.0)
        return modelled, extra

    def _steps(self, delay_s: float) -> Floats:
        """By how much a duty changes with goals that may be in it, or not yet, of every sample."""
        if delay_s not in self._changes:
            one = self._observed
            t_s = one.channels[Channel.DUTY].t_s
            first, last = t_s - delay_s - self._either_s, t_s - delay_s + self._either_s
            if self._renewed:
                first = np.concatenate([t_s[:1], t_s[:-1]]) - delay_s
            if self._told:
                last = np.minimum(last, t_s)
            angle = np.interp(t_s, one.position.t_s[one.position.good], good(one))
            now, before = (
                np.clip(self._gain * (held_at(one.goal, at_s) - angle), -1.0, 1.0)
                for at_s in (last, first)
            )
            if len(self._changes) > REMEMBERED:
                self._changes.clear()
            self._changes[delay_s] = np.abs(now - before)
        return self._changes[delay_s]

    def _drop(self, samples: Samples, drop: Floats) -> tuple[Floats, Floats]:
        """What a voltage register shows of a supply's drop, and the variance of that [V^2].

        ``drop`` (rollouts, samples) is of the replay's samples.
        """
        at = samples.index
        if not drop.any() or len(at) < 2:
            return drop[:, at], np.zeros_like(drop[:, at])
        if self._rail_s is not None:
            late_s = math.hypot(RAIL_S, self._rail_s)
            pace = np.gradient(drop, self._observed.replay.samples, axis=1)
            return drop[:, at], (pace[:, at] * late_s) ** 2
        if not self._observed.seldom:
            pace = np.gradient(drop[:, at], samples.t_s, axis=1)
            return drop[:, at], (pace * RAIL_S) ** 2
        first = np.searchsorted(self._observed.replay.samples, samples.t_s - self._observed.stale_s)
        count = at + 1 - first
        mean, square = (
            np.diff(np.stack([total[:, first], total[:, at + 1]]), axis=0)[0] / count
            for total in (np.cumsum(np.pad(drop**n, ((0, 0), (1, 0))), axis=1) for n in (1, 2))
        )
        return mean, np.maximum(square - mean**2, 0.0)


def averaged(
    t_s: Floats, value: Floats, extra: Floats, window_s: float
) -> tuple[Floats, Floats, Floats]:
    """Means over windows of time of rows (rows, n); what is sampled less often stays as it is."""
    window = np.floor((t_s - t_s[0]) / window_s)
    first = np.flatnonzero(np.diff(window, prepend=-1.0))
    count = np.diff(np.append(first, len(window)))
    t_s, value, extra = (np.add.reduceat(x, first, axis=-1) / count for x in (t_s, value, extra))
    return t_s, value, extra


def runs_away(blocks: Mapping[Any, Block]) -> bool:
    """Whether rollouts are no numbers any more: a gear is too stiff for so light a load."""
    return any((np.abs(block.value) >= WILD).any() for block in blocks.values())


def good(observed: Observed) -> Floats:
    """The recorded angles that are to be believed [rad]."""
    samples = observed.position
    return samples.value[samples.good]


def speed(observed: Observed) -> Floats:
    """Speed of the joint at every sample of the replay [rad/s], from smoothed positions."""
    samples = observed.position
    t, q = samples.t_s[samples.good], good(observed)
    span = max(3, round(0.02 / max(1e-4, float(np.median(np.diff(t))))) | 1)
    weights = np.ones(span) / span
    smooth = np.convolve(np.pad(q, span // 2, mode="edge"), weights, mode="valid")
    found: Floats = np.abs(np.interp(observed.replay.samples, t, np.gradient(smooth, t)))
    return found
