"""Which experiment would tell two explanations apart.

Both are run through every experiment of a menu. What tells them apart is how far their predictions
lie from each other, in units of the noise (Hunter and Reiner, Technometrics 7, 1965), once the
rival has done what it can to follow: its own size and all nuisances, as far as the recordings that
there are let them (Atkinson and Fedorov, Biometrika 62, 1975). The power is the chance that the
likelier of the two is then the true one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
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
from .fit import ENOUGH, Fit, block_costs, bounds, least_squares, linearise, prior_cost, whitened
from .floor import engines_rad
from .model import Blocks, JointModel, Kind
from .remaining import remaining, while_driven
from .rivals import CLOSE

Floats = NDArray[np.float64]

SAMPLE_S = 0.01  #: assumed pace of a bus that reads one servo
DURATION_S = 6.0
GAINS = (0.5, 1.0, 2.0)  #: of the position gain that was recorded
BOLDER = 1.3  #: of the motion's size that was recorded, if the joint may go so far
LEAST_RAD = 0.05  #: of its amplitude; assumed
NEARER = 0.5  #: of a weight's distance from the axis: where else it may be hung
WEIGHT, PLACE = "payload_kg", "payload_at_m"  #: words of a recording's condition
FOLLOWED = 4  #: steps that a rival follows in each experiment of the menu, at most
SHARES = (1.0, 0.5, 0.2, 0.05)  #: of a step, of which the best is gone
FITTED = 6  #: steps of a rival's fit to what an experiment would show
ASKED = 16  #: experiments at most that rivals are fitted to
SURE = 5.0  #: deviations that are enough (a power of 0.994): no other experiment is looked for
GAIN_REGISTERS = ("position_p_gain", "p_gain", "cw_compliance_slope")


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """An experiment of the menu, and what it would be seen as."""

    plan: ExperimentPlan
    observed: Observed


def menu(model: JointModel) -> list[Choice]:
    """Every motion, in the range recorded, at a few gains and with the weights that were used.

    Also, at the gain recorded, with the heaviest of these hung nearer to the axis, and without any:
    what is in the weight, and what in the arm.
    """
    positions = np.concatenate([o.position.value[o.position.good] for o in model.observed])
    low, high = np.quantile(positions, [0.01, 0.99])
    centre = model.mount.to_joint(0.5 * float(high + low))
    joint = model.base.joints[model.index]
    room = min(joint.upper_rad - centre, centre - joint.lower_rad)
    reached = 0.5 * float(high - low)
    amplitude = max(reached, min(max(BOLDER * reached, LEAST_RAD), room))
    used: dict[tuple[float | None, ...], Observed] = {}
    for one in model.observed:
        used.setdefault(tuple(one.condition.get(word) for word in (WEIGHT, PLACE)), one)
    settings = [(gain, like) for gain in GAINS for like in used.values()]
    settings += [(1.0, like) for like in _otherwise_loaded(model)]
    choices = []
    for name in sorted(MOTIONS):
        for gain, like in settings:
            moves = motion(name, amplitude_rad=amplitude, center_rad=centre, duration_s=DURATION_S)
            registers = _registers(model.table, like, gain)
            if registers is None:
                continue
            weight, place = (like.condition.get(word) for word in (WEIGHT, PLACE))
            plan = ExperimentPlan(moves, registers, weight, place)
            choices.append(Choice(plan, _imagined(model, like, plan, gain)))
    return choices


def _otherwise_loaded(model: JointModel) -> list[Observed]:
    """Recordings as they might be with the heaviest weight elsewhere, and with none."""
    fixed = model.base.payload
    if fixed is None:
        return []

    def weight(one: Observed) -> float:
        return float(one.condition.get(WEIGHT, fixed.mass_kg))

    heaviest = max(model.observed, key=weight)
    away = float(heaviest.condition.get(PLACE, math.hypot(*fixed.at_m)))
    if not weight(heaviest) * away:
        return []
    told = [{WEIGHT: weight(heaviest), PLACE: NEARER * away}]
    if min(map(weight, model.observed)):
        told.append({WEIGHT: 0.0})
    return [replace(heaviest, condition={**heaviest.condition, **each}) for each in told]


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
    contests = {
        rival: Contest(model, imagined, named, other, information(model, other), inflation)
        for rival, other in rivals.items()
    }
    promised = {
        rival: [contest.promised(r) for r in range(len(choices))]
        for rival, contest in contests.items()
    }
    found = []
    for best, told, power in most_telling(promised, lambda rival, r: contests[rival].fitted(r)):
        document = choices[best].plan.document()
        others = [rivals[rival].hypothesis.effects for rival in told]
        apart = separated(named.hypothesis.effects, others) or told
        found.append(NextExperiment(str(document["motion"]), document, apart, power))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Contest:
    """A named hypothesis against a rival, in experiments that nobody has made.

    ``model`` has the recordings that there are, ``imagined`` the experiments; ``known`` is what the
    former say of the rival's numbers (:func:`information`), ``inflation`` how much too sure the
    likelihood is of a difference.
    """

    model: JointModel
    imagined: JointModel
    named: Fit
    other: Fit
    known: Floats
    inflation: float

    def promised(self, r: int) -> float:
        """How many deviations two are apart in an experiment, once the rival has followed."""
        z, nats = self._followed(r)
        (ours,) = self.imagined.residuals(self.named.hypothesis, [self.named.z], [r])
        (theirs,) = self.imagined.residuals(self.other.hypothesis, [z], [r])
        one = self.imagined.observed[r]
        apart = {
            key: while_driven(one, replace(block, value=block.value - ours[key].value))
            for key, block in theirs.items()
        }
        return self._deviations(nats, apart)

    def fitted(self, r: int) -> float:
        """The same once the rival is fitted to that as well as to all that was recorded."""
        noise, hypothesis = self.named.noise, self.other.hypothesis
        both = self.model.of([*self.model.observed, self.shown(r)])
        last = [len(self.model.observed)]
        begun = min((self.other.z, self._followed(r)[0]), key=lambda z: self._cost(both, z))
        box = bounds(both, hypothesis)
        z = least_squares(both, hypothesis, begun, noise, None, box, FITTED)
        (ours,) = both.residuals(self.named.hypothesis, [self.named.z], last)
        before = min(self._cost(self.model, there) for there in (self.other.z, z))
        nats = self._cost(both, z) - before - sum(block_costs(ours, noise).values())
        left = remaining(both, Fit(hypothesis, z, noise, np.inf), last, driven=True)
        return self._deviations(nats, left)

    def _followed(self, r: int) -> tuple[Floats, float]:
        """Where the rival goes to follow in an experiment, and what is left between them [nats].

        All that was recorded holds it as ``known`` says.
        """
        noise, hypothesis, start = self.named.noise, self.other.hypothesis, self.other.z
        (ours,) = self.imagined.residuals(self.named.hypothesis, [self.named.z], [r])
        box = bounds(self.imagined, hypothesis)

        def apart(vectors: Sequence[Floats]) -> list[tuple[float, Floats, Floats]]:
            found = []
            for z, theirs in zip(
                vectors, self.imagined.residuals(hypothesis, vectors, [r]), strict=True
            ):
                away = whitened([theirs, ours], noise)[1][:, 0]
                held = (z - start) @ self.known @ (z - start)
                found.append((0.5 * float(away @ away + held), z, away))
            return found

        (now,) = apart([start])
        for _ in range(FOLLOWED):
            nats, z, away = now
            _, jacobian = linearise(self.imagined, hypothesis, z, noise, [r])
            way = follows(away, jacobian, self.known, z - start)
            tried = apart([np.clip(z + share * way, *box) for share in SHARES])
            best = min(tried, key=lambda one: one[0])
            if best[0] < nats:
                now = best
            if best[0] > nats - ENOUGH:
                break
        return now[1], now[0]

    def _deviations(self, nats: float, apart: Blocks) -> float:
        """Deviations that some nats are, if what is left (residuals by kind) can be seen at all.

        By less than two sound simulations differ in it, :mod:`.rivals` does not tell two apart,
        however many nats it is.
        """
        enough = told_by(self.model)
        seen = max(
            float(np.mean(block.value**2)) / enough[kind] ** 2 for (_, kind), block in apart.items()
        )
        return math.sqrt(2.0 * max(0.0, min(nats / self.inflation, CLOSE * seen)))

    def _cost(self, model: JointModel, z: Floats) -> float:
        (blocks,) = model.residuals(self.other.hypothesis, [z])
        return sum(block_costs(blocks, self.named.noise).values()) + prior_cost(model, z)

    def shown(self, r: int) -> Observed:
        """An experiment as it would be recorded if what is named were all."""
        one = self.imagined.observed[r]
        (blocks,) = self.imagined.residuals(self.named.hypothesis, [self.named.z], [r])
        channels = dict(one.channels)
        for (_, kind), block in blocks.items():
            samples = channels[kind.channel]
            modelled = np.interp(samples.t_s, block.t_s, -block.value)
            channels[kind.channel] = replace(samples, value=modelled)
        return replace(one, channels=channels)


def information(model: JointModel, found: Fit) -> Floats:
    """What the recordings of a model, and priors, say of a fit's numbers (k, k)."""
    residual, jacobian = linearise(model, found.hypothesis, found.z, found.noise)
    known: Floats = (jacobian * huber_weight(residual)[:, None]).T @ jacobian
    known[np.diag_indices(len(model.nuisances))] += 1.0
    return known


def told_by(model: JointModel) -> dict[Kind, float]:
    """RMS of every kind, in its unit, from which another group of recordings tells two apart.

    Those that differ by less are :func:`~.faint.hardly_better` than each other.
    """
    groups = 1 + len({one.group for one in model.observed})
    positions = engines_rad(model) * math.sqrt(max(ONCE, SHARED * groups))
    rest = {kind: math.sqrt(READ) * floor for kind, floor in model.floors().items()}
    return rest | {Kind.POSITION: positions}


def follows(apart: Floats, tangents: Floats, known: Floats, gone: Floats) -> Floats:
    """The way (k,) that numbers go to take away most of a whitened difference (n,).

    ``tangents`` (n, k) are what a unit of each takes away, ``known`` (k, k) what holds them where
    they were before they had ``gone`` (k,).
    """
    normal, pull = tangents.T @ tangents + known, tangents.T @ apart - known @ gone
    return np.asarray(np.linalg.lstsq(normal, pull, rcond=None)[0], np.float64)


def adapted(apart: Floats, tangents: Floats, known: Floats) -> float:
    """Length of a whitened difference once all numbers have done what they can about it.

    What it costs them to go elsewhere counts as well; see :func:`follows`.
    """
    helped = apart @ tangents @ follows(apart, tangents, known, np.zeros(len(known)))
    return math.sqrt(max(0.0, float(apart @ apart - helped)))


def most_telling(
    promised: Mapping[str, Sequence[float]],
    asked: Callable[[str, int], float] | None = None,
) -> list[tuple[int, tuple[str, ...], float]]:
    """Which experiments to make, each with the rivals that it is for, and its power.

    ``promised`` has, for each rival, how many deviations from the named hypothesis it is in every
    experiment; ``asked`` tells that of one better, and is asked about those that promise most.
    First that in which the nearest rival is farthest; then, where another is better for one of
    them, that for it.
    """
    apart = np.array(list(promised.values()), np.float64)
    some = np.argsort(-apart.min(axis=0), kind="stable").tolist()
    if asked is not None:
        likely, some = some[:ASKED], []
        for r in likely:
            apart[:, r] = [asked(rival, r) for rival in promised]
            some.append(r)
            if apart[:, r].min() >= SURE:
                break
    together = max(some, key=lambda r: float(apart[:, r].min()))
    found = [(together, tuple(promised), _power(float(apart[:, together].min())))]
    for rival, own in zip(promised, apart, strict=True):
        best = max(some, key=lambda r: float(own[r]))
        if own[best] > own[together] and own[together] < SURE:
            found.append((best, (rival,), _power(float(own[best]))))
    return found


def separated(named: Iterable[str], others: Iterable[Iterable[str]]) -> tuple[str, ...]:
    """Effects that a hypothesis and some others do not share: what is to be told apart."""
    own = set(named)
    return tuple(sorted(set().union(*(own ^ set(other) for other in others))))


def _power(distance: float) -> float:
    """The chance that the likelier of two, so many deviations apart, is the true one."""
    return NormalDist().cdf(0.5 * distance)
