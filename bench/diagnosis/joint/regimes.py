"""Where in a motion a misfit lives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.drive import fields

from ..observed import Channel, Observed, held_at
from .model import Blocks, Kind

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

EVERYWHERE = "everywhere"  #: the place of what no part of a motion has more of than the rest
SHUFFLES = 400  #: of stretches, for a p-value
STRETCH_S = 0.25  #: what is shuffled as one
SLOW_SHARE, FAST_SHARE = 0.1, 0.6  #: of the highest speed in the recordings
REVERSAL_S = 0.15  #: after a change of direction
LOADED_DUTY = 0.6
SATURATED_DUTY = 0.98


@dataclass(frozen=True, slots=True)
class Place:
    """A part of the motion and its share of the squared residual."""

    channel: str
    joint: str
    phase: str
    share: float
    time_share: float
    p_value: float


def regimes(observed: Observed, top_speed: float) -> dict[str, Mask]:
    """Parts of a motion, by name: masks over the position samples."""
    samples = observed.position
    t = samples.t_s
    smooth = np.convolve(np.pad(samples.value, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
    velocity = np.gradient(smooth, t)
    speed = np.abs(velocity)
    moving = speed > SLOW_SHARE * top_speed
    direction = np.sign(np.where(moving, velocity, 0.0))
    last, turned_s = 0.0, np.full(len(t), -np.inf)
    for k, way in enumerate(direction.tolist()):
        turned_s[k] = turned_s[k - 1] if k else -np.inf
        if way and last and way != last:
            turned_s[k] = t[k]
        last = way or last
    parts = {
        "at_rest": ~moving,
        "high_speed": speed > FAST_SHARE * top_speed,
        "reversal": t - turned_s < REVERSAL_S,
        "first_second": t < t[0] + 1.0,
        "late": t > t[0] + 0.75 * (t[-1] - t[0]),
    }
    duty = observed.channels.get(Channel.DUTY)
    if duty is not None and len(duty.t_s) > 1:
        at = np.abs(np.interp(t, duty.t_s, duty.value))
        parts["high_load"] = at > LOADED_DUTY
        parts["saturation"] = at > SATURATED_DUTY
    else:
        start = observed.replay.start
        gain = max(start[fields.GAIN_CW], start[fields.GAIN_CCW])
        error = held_at(observed.goal, t) - samples.value
        parts["high_load"] = gain * np.abs(error) > LOADED_DUTY
    return parts


def top_speed(observed: Sequence[Observed]) -> float:
    """A speed [rad/s] that the joint reaches in a twentieth of the samples."""
    speeds = [
        np.abs(np.gradient(o.position.value[o.position.good], o.position.t_s[o.position.good]))
        for o in observed
    ]
    return float(np.quantile(np.concatenate(speeds), 0.95)) + 1e-9


def localise(
    observed: Sequence[Observed], blocks: Blocks, floor: float, seed: int = 0
) -> list[Place]:
    """Parts of the motion by their share of the misfit, the largest first.

    The p-value is that of so large a share when stretches of time are shuffled within recordings,
    times the number of parts that were looked at (at most 1).
    """
    fastest = top_speed(observed)
    random = np.random.default_rng(seed)
    squares: list[Floats] = []
    masks: dict[str, list[Mask]] = {}
    for r, one in enumerate(observed):
        block = blocks.get((r, Kind.POSITION))
        if block is None:
            continue
        squares.append(np.maximum(block.value**2 - floor**2, 0.0))
        good = one.position.good
        for name, mask in regimes(one, fastest).items():
            masks.setdefault(name, []).append(mask[good])
    names = [n for n, parts in masks.items() if len(parts) == len(squares)]
    total = sum(float(s.sum()) for s in squares)
    if total <= 0.0:
        return []
    stretches = [
        np.floor(blocks[r, Kind.POSITION].t_s / STRETCH_S).astype(np.int64)
        for r in range(len(observed))
        if (r, Kind.POSITION) in blocks
    ]
    of_parts = {name: np.concatenate(masks[name]) for name in names}
    of_parts = {name: mask for name, mask in of_parts.items() if 0.0 < mask.mean() < 1.0}
    table = np.array(list(of_parts.values()), np.float64).reshape(len(of_parts), -1)
    found = table @ np.concatenate(squares)
    above = np.zeros(len(of_parts))
    for _ in range(SHUFFLES):
        drawn = [_shuffled(s, k, random) for s, k in zip(squares, stretches, strict=True)]
        above += table @ np.concatenate(drawn) >= found
    chances = np.minimum(1.0, (above + 1.0) / (SHUFFLES + 1.0) * len(names))
    places = [
        Place(
            "present_position", observed[0].joint, name, float(share), float(mask.mean()), float(p)
        )
        for (name, mask), share, p in zip(of_parts.items(), found / total, chances, strict=True)
    ]
    return sorted(places, key=lambda place: (place.p_value, place.time_share - place.share))


def _shuffled(squares: Floats, stretch: NDArray[np.int64], random: np.random.Generator) -> Floats:
    """Squares whose stretches follow each other in another order, each whole."""
    order = random.permutation(int(stretch.max()) + 1)
    return squares[np.argsort(order[stretch], kind="stable")]


def shares(places: Sequence[Place]) -> Mapping[str, float]:
    """Shares by part."""
    return {place.phase: place.share for place in places}
