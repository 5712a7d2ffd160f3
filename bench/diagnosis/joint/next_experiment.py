"""Which experiment would tell two explanations apart.

Both are run through every experiment of a menu. What tells them apart is how far their predictions
lie from each other once the nuisances have done what they can to bring them together, in units of
the noise (Hunter and Reiner, Technometrics 7, 1965). The power is the chance that the likelier of
the two is then the true one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from bench.motions import MOTIONS, ExperimentPlan, motion
from busemu.tables import ControlTable
from sim.drive import fields
from sim.rollout import Replay

from ..observed import Channel, Observed, Samples
from ..result import NextExperiment
from .fit import Fit, linearise, whitened
from .model import JointModel

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
    """The best experiment against every rival of a named hypothesis."""
    if not rivals:
        return []
    choices = menu(model)
    seen = [c.observed for c in choices]
    imagined = JointModel(model.base, model.robot, seen, sprung=model.sprung)
    found = []
    for rival, other in rivals.items():
        distances = [_distance(imagined, named, other, r) for r in range(len(choices))]
        best, power = most_telling(distances, inflation)
        document = choices[best].plan.document()
        names = sorted(set(named.hypothesis.effects) ^ {rival, *other.hypothesis.effects})
        found.append(
            NextExperiment(str(document["motion"]), document, tuple(names or [rival]), power)
        )
    return found


def _distance(model: JointModel, named: Fit, other: Fit, r: int) -> float:
    """How far apart two hypotheses are in one recording, in deviations, nuisances adapted."""
    residual, jacobian = linearise(model, named.hypothesis, named.z, named.noise, [r])
    blocks = [
        model.residuals(named.hypothesis, [named.z], [r])[0],
        model.residuals(other.hypothesis, [other.z], [r])[0],
    ]
    _, differences = whitened(blocks, named.noise)
    apart = differences[:, 0]
    return adapted(apart, jacobian[:, : len(model.nuisances)]) if len(residual) else 0.0


def adapted(apart: Floats, tangents: Floats) -> float:
    """Length of a whitened difference (n,) once nuisances have done what they can about it.

    ``tangents`` (n, k) are what a deviation of each does.
    """
    normal = tangents.T @ tangents + np.eye(tangents.shape[1])
    left = apart - tangents @ np.linalg.solve(normal, tangents.T @ apart)
    return float(np.linalg.norm(left))


def most_telling(distances: Sequence[float], inflation: float) -> tuple[int, float]:
    """The experiment in which two hypotheses are farthest apart, and its power.

    ``inflation`` is how much too sure the likelihood is of a difference.
    """
    deflated = [distance / np.sqrt(inflation) for distance in distances]
    best = int(np.argmax(deflated))
    return best, NormalDist().cdf(0.5 * float(deflated[best]))
