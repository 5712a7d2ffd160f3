"""Sizes in units of the detection floor, measured on the generator's own rollouts.

The noise floor of a rig's programme is the position's quantisation (a step over the square root of
12), the sensor's noise and the spread of repeats (of friction, start and supply: in what phase the
firmware's ticks are is not in it), added as squares. An effect's *ratio* is the RMS
change of the register's trace over the whole programme, on the rig as it is believed to be and as
its servo is built, divided by that floor; at ratio 1 it is at the detection floor. Thresholds make
the trace jump: the smallest size that reaches a ratio is taken, and the ratio that it truly has is
kept.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .changes import Setting
from .effects import EFFECTS, POSITION, Effect
from .host import Line, commands, schedule, show
from .nuisances import Nuisances, draw_passing
from .pendulum import roll
from .rigs import RIGS, STYLES, Programme, Rig, Run, Style
from .specimen import SIMPLEST, Build, Specimen
from .unlisted import STRANGERS

Floats = NDArray[np.float64]

AS_BELIEVED = Nuisances()
RATIOS = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0)
CLOSE = 0.05  #: a ratio within 5 % of the wanted one will do
TRIES = 9
EDGE = 1e-12  #: a size that is as good as 0, yet has the allowance of its nuisance


def effect_named(name: str) -> Effect:
    """An effect or a stranger by its name. Raises ``ValueError`` with those there are."""
    found = EFFECTS.get(name) or STRANGERS.get(name)
    if found is None:
        raise ValueError(
            f"no effect named {name!r}: use one of {', '.join((*EFFECTS, *STRANGERS))}"
        )
    return found


class Key(NamedTuple):
    """Of a ground, by names: results are kept by it."""

    rig: str
    programme: str
    style: str
    build: Build = SIMPLEST


@dataclass(frozen=True)
class Ground:
    """Where an effect is measured: a rig, what is done with it, how it is sampled, and built."""

    rig: Rig
    programme: Programme
    style: Style
    build: Build = SIMPLEST

    @property
    def key(self) -> Key:
        """By which results are kept."""
        return Key(self.rig.name, self.programme.name, self.style.name, self.build)

    def specimen(self, payload_kg: float | None = None) -> Specimen:
        """The rig as it is believed to be, and as its servo is built."""
        return self.rig.specimen(payload_kg, self.build)


def ground(key: Key) -> Ground:
    """The ground of a key."""
    rig = RIGS[key.rig]
    return Ground(rig, rig.by_name()[key.programme], STYLES[key.style], key.build)


def observe(style: Style, run: Run, specimen: Specimen, channel: str = POSITION) -> Floats:
    """A register's trace without rounding and noise, under an undisturbed schedule."""
    line = Line(latency_s=0.0)
    timing = schedule(style, run.plan.motion.duration_s, line, np.random.default_rng(0))
    trace = roll(specimen, commands(run.plan, specimen.sheet, timing))
    shown = show(specimen, trace, timing, line, np.random.default_rng(1))
    return shown.roles["position" if channel == POSITION else "duty"]


def traces(
    where: Ground,
    effect: Effect | None,
    size: float,
    how: Setting,
    nuisances: Nuisances = AS_BELIEVED,
    groups: Collection[str] | None = None,
) -> Floats:
    """Traces of all groups of the programme (or some), one after another."""
    channel = effect.channel if effect else POSITION
    found = []
    for run in where.programme.runs:
        if groups is not None and run.group not in groups:
            continue
        specimen = nuisances.on(where.specimen(run.plan.payload_kg))
        if effect is not None:
            specimen, _ = effect.apply(specimen, size, how)
        found.append(observe(where.style, run, specimen, channel))
    return np.concatenate(found)


def rms(values: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


@cache
def noise_floor(key: Key, channel: str = POSITION) -> float:
    """The noise floor of a register over a programme, in its SI unit."""
    where = ground(key)
    sheet = where.rig.sheet
    role = "position" if channel == POSITION else "duty"
    step = sheet.table[sheet.roles[role]].si_scale
    apart = []
    for run in where.programme.runs:
        believed = where.specimen(run.plan.payload_kg)
        repeats = [draw_passing(np.random.default_rng(n), n).on(believed) for n in (0, 1)]
        first, second = (
            observe(where.style, run, one.but(tick_phase=0.0), channel) for one in repeats
        )
        apart.append(first - second)
    spread = rms(np.concatenate(apart)) / math.sqrt(2.0)
    noise = believed.sensing.noise_steps * step if channel == POSITION else 0.0
    return math.sqrt(step**2 / 12.0 + noise**2 + spread**2)


@lru_cache(maxsize=512)
def _reference(key: Key, name: str, how: Setting) -> Floats:
    effect = effect_named(name)
    return traces(ground(key), effect, EDGE if effect.allowance else 0.0, how)


@lru_cache(maxsize=4096)
def ratio(key: Key, name: str, size: float, how: Setting) -> float:
    """An effect's RMS change over the noise floor."""
    return rms(change(key, name, size, how)) / noise_floor(key, effect_named(name).channel)


def change(key: Key, name: str, size: float, how: Setting) -> Floats:
    """How an effect changes the trace."""
    with np.errstate(all="raise"):
        moved = traces(ground(key), effect_named(name), size, how) - _reference(key, name, how)
    return moved


def ratio_fitted(
    where: Ground, name: str, size: float, how: Setting, nuisances: Nuisances
) -> float:
    """An effect's ratio with a case's nuisances, in the groups that are for fitting."""
    groups = {run.group for run in where.programme.runs} - set(where.programme.held_out)
    effect = effect_named(name)
    moved, still = (traces(where, effect, p, how, nuisances, groups) for p in (size, 0.0))
    return rms(moved - still) / noise_floor(where.key, effect.channel)


@dataclass(frozen=True, slots=True)
class Size:
    """A size of an effect, and the ratio it has."""

    size: float
    ratio: float


@cache
def size_for(key: Key, name: str, wanted: float, how: Setting) -> Size | None:
    """The size at which an effect has a ratio; ``None`` where no plausible size reaches it."""
    effect = effect_named(name)
    low, low_ratio = 0.0, 0.0
    high = high_ratio = math.inf
    size = effect.typical
    for _ in range(TRIES):
        now = ratio(key, name, size, how)
        if abs(now / wanted - 1.0) < CLOSE:
            return Size(size, now)
        if now < wanted:
            if size >= effect.most:
                return None
            low, low_ratio = size, now
        else:
            high, high_ratio = size, now
        size = _next(effect, wanted, (low, low_ratio), (high, high_ratio))
    return Size(high, high_ratio) if math.isfinite(high) else None


def _next(
    effect: Effect, wanted: float, low: tuple[float, float], high: tuple[float, float]
) -> float:
    """A size between what is too little and what is too much."""
    if math.isinf(high[0]):
        faster = wanted / low[1] if low[1] > 0.0 else 4.0
        return min(effect.most, low[0] * min(max(faster, 1.2), 8.0))
    if low[0] == 0.0:
        return high[0] * max(wanted / high[1], 0.02)
    if low[1] > 0.05 * wanted and high[1] < 20.0 * wanted:
        slope = math.log(high[1] / low[1]) / math.log(high[0] / low[0])
        share = math.log(wanted / low[1]) / slope / math.log(high[0] / low[0])
        share = min(max(share, 0.1), 0.9)
    else:
        share = 0.5
    return float(low[0] * (high[0] / low[0]) ** share)
