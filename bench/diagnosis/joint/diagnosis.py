"""The diagnosis of one joint: from recordings to a verdict."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from busemu.wording import amount
from sim.drive import fields
from sim.effects import Effect
from sim.robot import PhysicalRobot

from ..journal import Journal
from ..knobs import SEEN, joint_effects, of_drive
from ..observed import Observed
from ..result import Cause, Diagnosis, FitSummary, NextExperiment, beside_rest, verdict_of
from ..watch import Watch
from .beginning import begun
from .contradiction import supply_contradiction
from .faint import strained
from .fit import Fit, estimate_noise
from .instants import believed_refresh_s
from .intervals import estimates
from .lost import lost_samples
from .model import Blocks, JointModel, Kind
from .next_experiment import next_experiments
from .nuisances import WITHIN, Nuisance
from .play import PLAY, play, play_cause
from .regimes import EVERYWHERE, localise
from .remaining import block_rms, remaining, while_driven
from .renewed import load_refresh
from .rest import Rest, is_worse, rest_of, volts_left
from .rhythm import short_refresh
from .rivals import contemporaries, rivals
from .search import Progress, beside_others
from .views import Views, unlike
from .worth import explained, rms_of, shown_share

Floats = NDArray[np.float64]

SIGNIFICANT = 0.05
AFTER_ALL = (
    "recordings that were held out differ as no other does; {} of them were fitted after all, so "
    "that what was found is judged on the same motions alone"
)
HUNTS = (
    "{} swings by itself, and replays do not keep step with that: they were led along what was "
    "recorded, by a leash of {:g} rad/s, and errors are those on it; without it they are "
    "{:.3g} rad before and {:.3g} rad after"
)


@dataclass(frozen=True, slots=True, eq=False)
class JointFindings:
    """A diagnosis with what pictures and the improved model are made from."""

    diagnosis: Diagnosis
    model: JointModel
    before: Fit
    after: Fit
    judge: JointModel  #: recordings not used to fit, or the same when there are none


def diagnose_joint(
    base: PhysicalRobot,
    robot: Robot,
    observed: Sequence[Observed],
    judged: Sequence[Observed] = (),
    *,
    effects: Mapping[str, Effect] | None = None,
    seen: Collection[str] = SEEN,
    seed: int = 0,
    say: Progress = lambda _: None,
    journal: Journal | None = None,
) -> JointFindings:
    """Diagnose one joint on ``observed`` recordings, judge it on ``judged`` ones.

    ``base`` is what the operator believes; ``effects`` the catalogue to choose from;
    ``seen`` those of it that are seen in the data itself. Where ``say`` is a :class:`Watch` and its
    time runs out, the search ends, and what was found until then is judged and told. ``journal``
    keeps what is done, and has what was done before.
    """
    watch = say if isinstance(say, Watch) else Watch(say)
    (drive,) = (j.drive for j in base.joints if j.name == observed[0].joint)
    effects = of_drive(joint_effects() if effects is None else effects, drive)
    observed, judged = begun(base, robot, observed), begun(base, robot, judged)
    renewed = load_refresh(observed, believed_refresh_s(robot, observed[0].joint))
    period_s = renewed.parameters["period_s"].value if renewed else None
    watch.tell("fitting what the operator believes")
    joint = Views(base, robot, effects, journal, period_s, watch)
    view = joint.look(observed, judged)
    added = () if watch.stopped is not None else unlike(view)
    if added:
        watch.tell("recordings that were held out differ as no other does: some are fitted, too")
        judged = [one for one in judged if one.name not in added]
        observed = [*observed, *(one for one in view.judge.observed if one.name in added)]
        view = joint.look(observed, judged)
    model, before, judge, settled = view.model, view.before, view.judge, view.settled
    start_blocks, floor, floors = view.start, view.floor, view.floors
    after, taken, effects = settled.after, settled.taken, settled.effects
    found, nexts = [], dict[str, list[NextExperiment]]()
    for gain in taken:
        probability, close, fits, without = (
            contemporaries(model, after, gain, settled.confirmed)
            if watch.late
            else rivals(model, after, gain.effect, effects, settled.confirmed, watch.tell)
        )
        close = [rival for rival in close if rival.effect not in settled.refuted]
        fits = {rival.effect: fits[rival.effect] for rival in close if rival.effect in fits}
        if fits and not watch.late:
            watch.tell(f"what would tell {gain.effect} from its rivals")
            nexts[gain.effect] = next_experiments(model, after, fits, gain.inflation)
        found.append((gain, without, probability, close))
    if len(taken) > 1:
        taken = beside_others(model, after, [(one[0], one[1]) for one in found], floors)
    watch.tell("looking at what is left")
    rest = rest_of(model, judge, after, floor, seed)
    calm = [block_rms(remaining(judge, found), Kind.POSITION) for found in (before, after)]
    causes = [
        beside_rest(
            Cause(
                effect=gain.effect,
                scope=(observed[0].joint,),
                parameters=estimates(model, after, gain.effect),
                held_out_gain_nats=gain.outside,
                explained_share=explained([judge], before, without, after, floor),
                probability=probability,
                indistinguishable_from=tuple(close),
            ),
            rest.foretold,
            calm[0] ** 2 - floor**2,
            shown_share({model, judge}, without, after),
        )
        for gain, (_, without, probability, close) in zip(taken, found, strict=True)
    ]
    lost = lost_samples([*observed, *judged], after.noise[Kind.POSITION].total)
    renewed = renewed or short_refresh(model, after)
    in_data = [cause for cause in (renewed, lost) if cause is not None]
    causes += [cause for cause in in_data if cause.effect in seen]
    pushed = None if PLAY in after.hypothesis.effects else play(observed)
    if pushed is not None and PLAY in effects:
        causes.append(play_cause(pushed, observed[0].joint, after.noise[Kind.POSITION].total))
    rejected = told_once(settled.rejected, causes)
    unnamed = any(cause.effect not in seen for cause in in_data)
    worse = bool(causes) and is_worse(calm[0], calm[1], floor)
    stands_in = not causes and strained(model, after)  # that something is left nobody may deny
    structured = unnamed or worse or stands_in or rest.structured
    power = _unexplained_volts(observed[0].joint, volts_left(model, after))
    verdict = verdict_of(bool(causes), structured or bool(power))
    if verdict != "consistent" and not watch.late:
        rejected = _latest([*rejected, *supply_contradiction(model, before, after, watch.tell)])
    diagnosis = Diagnosis(
        verdict=verdict,
        mismatch=_mismatch(model, start_blocks, floor, seed) if verdict != "consistent" else (),
        causes=_surest(causes),
        fit=FitSummary(
            before=rms_of(judge, before),
            after=rms_of(judge, after),
            noise_floor=floor,
            held_out=bool(judged),
            recordings=tuple(o.name for o in (judged or observed)),
        ),
        unexplained=(*(_unexplained(judge, rest, floor, seed) if structured else ()), *power),
        next_experiment=tuple(n for cause in _surest(causes) for n in nexts.get(cause.effect, ())),
        limits=(
            *_limits(model, after, {kind for _, kind in start_blocks}, watch),
            *((AFTER_ALL.format(", ".join(sorted(added))),) if added else ()),
            *((pushed.words,) if pushed is not None else ()),
            *_hunting(judge, before, after),
        ),
        rejected=tuple(rejected),
        channels=channels_of(model, start_blocks, model.residuals(after.hypothesis, [after.z])[0]),
        ranking=tuple(
            {
                "effect": g.effect,
                "with": [n for n in g.fit.hypothesis.effects if n != g.effect],
                "gain_nats": float(g.nats),
                "inflation": float(g.inflation),
                "deflated_nats": float(g.deflated),
            }
            for g in settled.confirmed
        ),
        details=({"stopped": watch.stopped} if watch.stopped else {})
        | {
            "rollouts": model.rollouts,
            "taken_back": [row["effect"] for row in settled.rejected],
            "gear": "as the robot file has it" if model.sprung else "rigid",
            "leash_rad_s": model.leash_rad_s,
            "nuisances": {
                n.name: {"value": float(x) * n.deviation, "deviations": float(x), "unit": n.unit}
                for n, x in zip(model.nuisances, after.z, strict=False)
            },
            "noise": {
                kind.value: {
                    "white": noise.white,
                    "coloured": noise.coloured,
                    "memory_s": noise.memory_s,
                }
                for kind, noise in after.noise.items()
            },
            "remainder": {
                "predicted_rad": rest.remainder.predicted_rad,
                "share": rest.remainder.share,
                "agreeing": rest.remainder.agreeing,
            },
        },
    )
    return JointFindings(diagnosis, model, before, after, judge)


def _surest(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """Causes in the order they are told in."""
    return tuple(sorted(causes, key=lambda cause: -cause.held_out_gain_nats))


def _hunting(judge: JointModel, before: Fit, after: Fit) -> tuple[str, ...]:
    """What is to be said of a joint whose replays were on a leash."""
    if not judge.leash_rad_s:
        return ()
    free = judge.led(0.0)
    joint = judge.observed[0].joint
    return (HUNTS.format(joint, judge.leash_rad_s, rms_of(free, before), rms_of(free, after)),)


def told_once(
    rejected: Sequence[Mapping[str, Any]], causes: Sequence[Cause]
) -> list[Mapping[str, Any]]:
    """What is rejected, without what stands beside a cause as what it could be instead.

    A name that does not hold beside others may fit as well in the place of one of them.
    """
    rivals = {rival.effect for cause in causes for rival in cause.indistinguishable_from}
    return [row for row in rejected if row["effect"] not in rivals]


def _latest(rejected: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """One row for each name, the latest: it knows most."""
    return list({row["effect"]: row for row in rejected}.values())


def _mismatch(
    model: JointModel, blocks: Blocks, floor: float, seed: int
) -> tuple[Mapping[str, Any], ...]:
    return tuple(
        {
            "channel": place.channel,
            "joints": [place.joint],
            "phase": place.phase,
            "share": place.share,
            "p_value": place.p_value,
            "time_share": place.time_share,
        }
        for place in localise(model.observed, blocks, floor, seed)
        if place.p_value < SIGNIFICANT
    )


def _unexplained(
    judge: JointModel, rest: Rest, floor: float, seed: int
) -> tuple[Mapping[str, Any], ...]:
    told = rest.remainder
    places = [
        p for p in localise(judge.observed, rest.blocks, floor, seed) if p.p_value < SIGNIFICANT
    ]
    return (
        {
            "channel": "present_position",
            "joints": [judge.observed[0].joint],
            "predictable_rad": told.predicted_rad,
            "share": told.share,
            "where": [place.phase for place in places] or [EVERYWHERE],
            "terms": dict(told.terms),
        },
    )


def _unexplained_volts(joint: str, volts: float) -> tuple[Mapping[str, Any], ...]:
    told = {"channel": "present_voltage", "joints": [joint], "where": [EVERYWHERE]}
    return (told | {"rms_v": volts},) if volts > 0.0 else ()


def channels_of(model: JointModel, before: Blocks, after: Blocks) -> tuple[Mapping[str, Any], ...]:
    """What is left of every register: while the joint is driven, as elsewhere."""
    before, after = (
        {key: while_driven(model.observed[key[0]], block) for key, block in blocks.items()}
        for blocks in (before, after)
    )
    floors = model.floors()
    words = {
        Kind.POSITION: "the whole path from goal to motion",
        Kind.DUTY: "the controller alone, along the recorded angles",
        Kind.VOLTAGE: "the supply, under the modelled current",
    }
    rows = []
    there = {kind for _, kind in after}
    for kind, floor in floors.items():
        if kind not in there:
            continue
        noise = estimate_noise(model, {k: b for k, b in after.items() if k[1] is kind})
        rows.append(
            {
                "channel": kind.value,
                "judges": words[kind],
                "rms_before": block_rms(before, kind),
                "rms_after": block_rms(after, kind),
                "rounding": floor,
                "noise": noise[kind].total,
            }
        )
    return tuple(rows)


def _limits(
    model: JointModel, after: Fit, kinds: Collection[Kind], watch: Watch
) -> tuple[str, ...]:
    said = []
    if watch.stopped is not None:
        said.append(
            f"the time was used up before {watch.stopped!r}: effects may be missing that nobody "
            "had the time to try; the same command goes on from there"
        )
    if Kind.DUTY in set(model.floors()) - set(kinds):
        said.append(
            "the load or duty register was read and hardly ever changes: controller and motor are "
            "judged only together"
        )
    elif Kind.DUTY not in kinds:
        said.append(
            "no load or duty register was read: controller and motor are judged only together"
        )
    if Kind.VOLTAGE not in kinds:
        said.append(
            "no voltage register was read: a wrong or sagging supply looks like a weak motor"
        )
    groups = {o.group for o in model.observed}
    if len(groups) < 4:
        said.append(
            f"{amount(len(groups), 'group')} of recordings: what holds for one motion may not for "
            "another"
        )
    first = model.observed[0].replay.start
    if all(
        o.replay.start[fields.MODE] == fields.MODE_POSITION
        and abs(o.replay.start[fields.GAIN_CW] - first[fields.GAIN_CW]) < 1e-9
        for o in model.observed
    ):
        said.append("one position gain in all recordings: gain and torque are hard to tell apart")
    if strained(model, after):
        said.append(
            "tolerances, taken together, are further off than anybody believes: they may stand in "
            "for something that these recordings do not show"
        )
    return *said, *far_off(model.nuisances, after.z)


def far_off(nuisances: Sequence[Nuisance], z: Floats) -> tuple[str, ...]:
    """What is to be said of numbers that are far from what the robot's file says and doubts."""
    far = [
        f"{n.name.replace('_', ' ')} by {n.value(float(x), 1.0) - 1.0:+.0%} ({abs(x):.1f} "
        "deviations)"
        for n, x in zip(nuisances, z, strict=False)
        if n.reach > WITHIN and abs(float(x)) > WITHIN
    ]
    if not far:
        return ()
    return (
        "fitted as tolerances, further from the robot's file than its doubts make likely: "
        + ", ".join(far),
    )
