"""Which experiment would tell two explanations apart.

Both are run through every experiment of a menu. What tells them apart is how far their predictions
lie from each other, in units of the noise (Hunter and Reiner, Technometrics 7, 1965), once the
rival has done what it can to follow: its own size and all nuisances, as far as the recordings that
there are let them (Atkinson and Fedorov, Biometrika 62, 1975). The power is the chance that the
likelier of the two is then the true one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from bench.motions import MOTIONS, ExperimentPlan, motion
from busemu.tables import ControlTable
from sim.drive import fields
from sim.rollout import Replay

from ..noise import huber_weight
from ..observed import Channel, Observed, Samples
from ..result import NextExperiment
from .faint import ONCE, READ, SHARED
from .fit import Fit, bounds, linearise, whitened
from .floor import engines_rad
from .model import Blocks, JointModel, Kind
from .rivals import CLOSE

Floats = NDArray[np.float64]

SAMPLE_S = 0.01  #: assumed pace of a bus that reads one servo
DURATION_S = 6.0
GAINS = (0.5, 1.0, 2.0)  #: of the position gain that was recorded
BOLDER = 1.3  #: of the motion's size that was recorded
GAIN_REGISTERS = ("position_p_gain", "p_gain", "cw_compliance_slope")


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """An experiment of the menu, and what it would be seen as."""

    plan: ExperimentPlan
    observed: Observed


def menu(model: JointModel) -> list[Choice]:
    """Every motion, at a few gains and with the weights that were used, in the range recorded."""
    positions = np.concatenate([o.position.value[o.position.good] for o in model.observed])
    low, high = np.quantile(positions, [0.01, 0.99])
    amplitude, centre = BOLDER * 0.5 * float(high - low), 0.5 * float(high + low)
    seen: dict[float | None, Observed] = {}
    for one in model.observed:
        seen.setdefault(one.condition.get("payload_kg"), one)
    choices = []
    for name in sorted(MOTIONS):
        for gain in GAINS:
            for payload, like in seen.items():
                moves = motion(
                    name,
                    amplitude_rad=max(amplitude, 0.05),
                    center_rad=model.mount.to_joint(centre),
                    duration_s=DURATION_S,
                )
                registers = _registers(model.table, like, gain)
                if registers is None:
                    continue
                plan = ExperimentPlan(moves, registers, payload)
                choices.append(Choice(plan, _imagined(model, like, plan, gain)))
    return choices


def _registers(table: ControlTable, like: Observed, factor: float) -> Mapping[str, int] | None:
    """Gain registers for a factor on the recorded gain; ``None`` where they cannot have it."""
    if factor == 1.0:
        return dict(like.registers)
    for name in GAIN_REGISTERS:
        if name not in table:
            continue
        raw = like.registers.get(name, table[name].initial or 0)
        if name == "cw_compliance_slope":
            wanted = round(raw / factor)
            if not 2 <= wanted <= 128:
                return None
            return dict(like.registers) | {name: wanted, "ccw_compliance_slope": wanted}
        wanted = round(raw * factor)
        if not 0 < wanted <= table[name].maximum:
            return None
        return dict(like.registers) | {name: wanted}
    return None


def _imagined(model: JointModel, like: Observed, plan: ExperimentPlan, gain: float) -> Observed:
    """An experiment as if it had been recorded: the same channels, at an even pace."""
    t = np.arange(0.0, DURATION_S, SAMPLE_S)
    goals = np.array([model.mount.to_servo(g) for g in plan.motion.goal_rad(t).tolist()])
    start = like.replay.start.copy()
    for field in (fields.GAIN_CW, fields.GAIN_CCW):
        start[field] *= gain
    start[fields.GOAL_POSITION] = goals[0]
    events = np.stack([t, np.full_like(t, fields.GOAL_POSITION), goals], axis=1)
    off_s = plan.motion.torque_off_s
    if off_s is not None:
        events = np.concatenate([events, [[off_s, fields.ENABLED, 0.0]]])
        events = events[np.argsort(events[:, 0], kind="stable")]
    index = np.arange(len(t))
    channels: dict[Channel, Samples] = {
        channel: Samples(s.register, t, np.zeros(len(t)), s.quantum, index, np.ones(len(t), bool))
        for channel, s in like.channels.items()
        if channel is not Channel.DUTY
    }
    return replace(
        like,
        name="imagined",
        group="imagined",
        replay=Replay(start, events, t, float(goals[0])),
        channels=channels,
        goal=(t, goals),
        posture_rad=(
            None if like.posture_rad is None else like.posture_rad.mean(axis=0, keepdims=True)
        ),
    )


def next_experiments(
    model: JointModel, named: Fit, rivals: Mapping[str, Fit], inflation: float
) -> list[NextExperiment]:
    """Experiments that tell a named hypothesis from its rivals: first that from all of them."""
    if not rivals:
        return []
    choices = menu(model)
    imagined = JointModel(
        model.base, model.robot, [c.observed for c in choices], sprung=model.sprung
    )
    enough = told_by(model)
    apart = {}
    for rival, other in rivals.items():
        known = information(model, other)
        apart[rival] = [
            _distance(imagined, named, other, known, enough, inflation, r)
            for r in range(len(choices))
        ]
    found = []
    for best, told, power in most_telling(apart):
        document = choices[best].plan.document()
        names = set(named.hypothesis.effects)
        others = [set(rivals[rival].hypothesis.effects) for rival in told]
        separates = sorted(set().union(*(names ^ other for other in others)) or told)
        found.append(NextExperiment(str(document["motion"]), document, tuple(separates), power))
    return found


def information(model: JointModel, found: Fit) -> Floats:
    """What the recordings of a model, and priors, say of a fit's numbers (k, k)."""
    residual, jacobian = linearise(model, found.hypothesis, found.z, found.noise)
    known: Floats = (jacobian * huber_weight(residual)[:, None]).T @ jacobian
    known[np.diag_indices(len(model.nuisances))] += 1.0
    return known


def told_by(model: JointModel) -> dict[Kind, float]:
    """RMS of every kind, in its unit, from which another group of recordings tells two apart.

    By less than two sound simulations differ in it, they are :func:`~.faint.hardly_better` than
    each other, however sure the likelihood is.
    """
    groups = 1 + len({one.group for one in model.observed})
    positions = engines_rad(model) * math.sqrt(max(ONCE, SHARED * groups))
    rest = {kind: math.sqrt(READ) * floor for kind, floor in model.floors().items()}
    return rest | {Kind.POSITION: positions}


def _distance(
    model: JointModel,
    named: Fit,
    other: Fit,
    known: Floats,
    enough: Mapping[Kind, float],
    inflation: float,
    r: int,
) -> float:
    """How far apart two hypotheses are in one recording, in deviations, the other adapted.

    ``inflation`` is how much too sure the likelihood is of a difference, and ``enough`` what it
    must be of some kind (:func:`told_by`) for two to be told apart.
    """
    (ours,) = model.residuals(named.hypothesis, [named.z], [r])
    _, jacobian = linearise(model, other.hypothesis, other.z, named.noise, [r])

    def apart(z: Floats) -> tuple[Blocks, Floats]:
        (theirs,) = model.residuals(other.hypothesis, [z], [r])
        _, differences = whitened([theirs, ours], named.noise)
        return theirs, differences[:, 0]

    _, away = apart(other.z)
    z = np.clip(other.z + follows(away, jacobian, known), *bounds(model, other.hypothesis))
    theirs, left = apart(z)
    cost = (z - other.z) @ known @ (z - other.z)
    nats = 0.5 * float(min(away @ away, left @ left + cost)) / inflation
    seen = max(
        float(np.mean((block.value - ours[key].value) ** 2)) / enough[key[1]] ** 2
        for key, block in theirs.items()
    )
    return math.sqrt(2.0 * min(nats, CLOSE * seen))


def follows(apart: Floats, tangents: Floats, known: Floats) -> Floats:
    """The way (k,) that numbers go to take away most of a whitened difference (n,).

    ``tangents`` (n, k) are what a unit of each takes away, ``known`` (k, k) what holds them.
    """
    normal = tangents.T @ tangents + known
    return np.asarray(np.linalg.lstsq(normal, tangents.T @ apart, rcond=None)[0], np.float64)


def adapted(apart: Floats, tangents: Floats, known: Floats) -> float:
    """Length of a whitened difference once all numbers have done what they can about it.

    What it costs them to go elsewhere counts as well; see :func:`follows`.
    """
    helped = apart @ tangents @ follows(apart, tangents, known)
    return math.sqrt(max(0.0, float(apart @ apart - helped)))


def most_telling(apart: Mapping[str, Sequence[float]]) -> list[tuple[int, tuple[str, ...], float]]:
    """Which experiments to make, each with the rivals that it is for, and its power.

    ``apart`` has, for each rival, how many deviations from the named hypothesis it is in every
    experiment. First that in which the nearest rival is farthest; then, where another is better for
    one of them, that for it.
    """
    every = np.array(list(apart.values()))
    together = int(np.argmax(every.min(axis=0)))
    found = [(together, tuple(apart), _power(float(every[:, together].min())))]
    for rival, own in zip(apart, every, strict=True):
        best = int(np.argmax(own))
        if own[best] > own[together]:
            found.append((best, (rival,), _power(float(own[best]))))
    return found


def _power(distance: float) -> float:
    """The chance that the likelier of two, so many deviations apart, is the true one."""
    return NormalDist().cdf(0.5 * distance)
