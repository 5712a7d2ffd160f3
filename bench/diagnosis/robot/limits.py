"""What a diagnosis of a whole robot says of itself: what it could not see, and what stood in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..result import Cause, FitSummary
from .causes import SERIES
from .features import RobotKind
from .fit import RobotFit
from .model import RobotModel
from .shaking import SELDOM_S

FAR = 3.0  #: deviations of its prior at which a tolerance is worth a word


#: what shows a gain of a robot that stands
READ_LOADS = "; present_load of one servo a cycle, by turns, would show a low gain as it stands"


def limits(
    model: RobotModel, after: RobotFit, which: Sequence[int], held_out: bool
) -> tuple[str, ...]:
    """What recordings did not show, how a fit was judged, and tolerances that went far."""
    said = [
        "joints are compared by their means over the phase of the gait (over quarters of a "
        "second where there is no gait): what differs from cycle to cycle is not judged",
        "the fit before and after is that of the samples in which the robot walks (or of all "
        "after the first second): how it stands up before depends on how it lay",
        "temperature registers are not used for a whole robot, and loads only of joints that "
        "stand or move slowly",
    ]
    if RobotKind.VOLTAGE not in model.floors():
        said.append(
            "nobody read a voltage: a weak motor, a low supply and a low gain are hard to tell "
            "apart; read present_voltage of one servo a cycle, by turns"
        )
    if not {RobotKind.HEIGHT, RobotKind.LEAN} & set(model.floors()):
        said.append(
            "nobody watched the trunk: what gives way under the feet is seen by what joints "
            "do about it only; mocap/base_z_m shows it directly, or imu/roll_rad and imu/pitch_rad"
        )
    weights = {
        float(f.course.condition.get("payload_kg", f.course.condition.get("trunk_load_kg", 0)))
        for f in (model.features[r] for r in which)
    }
    if len(weights) < 2:
        said.append(
            "one load in all recordings that were fitted: what gives way under load and what "
            "is merely elsewhere are hard to tell apart; walk with a weight on the trunk"
        )
    said += unread(model, range(len(model.features))) + without_gait(model) + seldom(model)
    if not held_out:
        said.append("no recording was held out: what is named was judged on what was fitted")
    far = [
        n.name
        for n, x in zip(model.nuisances, after.nuisances.tolist(), strict=False)
        if abs(x) > FAR
    ]
    if far:
        said.append(f"taken far outside of what was believed without being named: {', '.join(far)}")
    return tuple(said)


def without_gait(model: RobotModel) -> tuple[str, ...]:
    """What is to be said of recordings in which a robot does not walk."""
    standing = [r for r, features in enumerate(model.features) if features.phase is None]
    if not standing:
        return ()
    names = ", ".join(model.features[r].course.name for r in standing)
    chance_rad = float(np.sqrt(np.mean(np.concatenate([model.chance(r) for r in standing]))))
    loads = RobotKind.DUTY in model.floors()
    alike = "a weak motor" if loads else "a weak motor, a low gain"
    return (
        f"no gait in {names}: where feet slip and stick, and where a robot that stands comes to "
        f"rest, is chance, here {chance_rad * 1e3:.1f} mrad within tolerances; {alike} and a heavy "
        "trunk look alike there, so that a robot may be called consistent that is not: let it "
        f"walk{'' if loads else READ_LOADS}",
    )


def seldom(model: RobotModel) -> tuple[str, ...]:
    """What is to be said of recordings of too few samples to see joints shake."""
    walks = (f for f in model.features if f.phase is not None)
    few = [f for f in walks if not np.isfinite(f.shaken).any()]
    waits = [np.diff(t) for f in few for t in f.course.sample_s]
    usual_s = float(np.median(np.concatenate(waits))) if waits else 0.0
    if usual_s <= SELDOM_S:  # else it is the motion that is as large as wrong packets make it
        return ()
    return (
        f"joints of {', '.join(f.course.name for f in few)} were read {usual_s * 1e3:.0f} "
        f"ms apart: by how much they shake is not seen, and so is play; {SELDOM_S * 1e3:.0f} ms "
        "show it, as one packet for several servos allows",
    )


def unread(model: RobotModel, which: Sequence[int]) -> tuple[str, ...]:
    """What is to be said of joints that some recordings did not read."""
    said: dict[tuple[str, ...], list[str]] = {}
    for r in which:
        course = model.features[r].course
        missing = [
            joint.name
            for joint, t in zip(model.base.joints, course.sample_s, strict=True)
            if not len(t)
        ]
        if missing:
            said.setdefault(tuple(missing), []).append(course.name)
    return tuple(
        f"nobody read {len(missing)} of {len(model.base.joints)} joints in "
        f"{', '.join(names)} ({', '.join(missing)}): they are taken to do what they were told, "
        "and nothing is said of them; read present_position of all"
        for missing, names in said.items()
    )


def stand_in(ends: Sequence[str]) -> tuple[str, ...]:
    """What is to be said of tolerances that stand in for what has no name."""
    if not ends:
        return ()
    return (
        f"tolerances that are as far off as they may be: {', '.join(ends)}; they stand in for "
        "something that has no name here: measure one of them and put it into the robot file",
    )


def in_series(causes: Iterable[Cause]) -> tuple[str, ...]:
    """What is to be said of a cause and a rival that are springs of which joints see the sum."""
    springs = {name.partition("@")[0] for name in SERIES}
    told = [{c.effect, r.effect} for c in causes for r in c.indistinguishable_from]
    if springs not in told:
        return ()
    return (
        "feet that give and a ground that gives are springs in series under every foot, of which "
        "joints see the sum: walk on another ground, what stays is the feet's",
    )


def other_volts(more_v: float) -> tuple[str, ...]:
    """What is to be said of a voltage that is not what the model has."""
    if more_v == 0.0:
        return ()
    return (
        f"servos show {abs(more_v):.2f} V {'more' if more_v > 0.0 else 'less'} than the better "
        "model's supply has at them, and no name that holds explains it: measure the supply under "
        "load, and put it into the robot file",
    )


def other_duties(off: float, where: str) -> tuple[str, ...]:
    """What is to be said of duties that no law as modelled makes of the recorded angles."""
    if off == 0.0:
        return ()
    return (
        f"loads of {where or 'all joints'} are {off:.0f} deviations from what the better model's "
        "law makes of recorded angles, and no name that holds explains it: compare the "
        "controller's registers (gains, punch, margins, limits) with the robot file",
    )


def far_samples(fit: FitSummary) -> tuple[str, ...]:
    """What is to be said of samples that are far off with all that is named."""
    return (
        f"samples in which the robot walks are {1e3 * fit.after:.1f} mrad off (RMS) with all that "
        f"is named, where a sound model leaves {1e3 * fit.noise_floor:.1f} mrad: something is the "
        "matter that has no name here; what else differs from the robot file?",
    )
