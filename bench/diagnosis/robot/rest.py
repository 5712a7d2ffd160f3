"""What is left of a whole robot's misfit that would be foretold: none of the above.

The misfit of the recordings that were fitted, joint by joint over the phase of the gait, foretells
that of the recordings that judge as far as it is structure and not noise. What two sound engines
leave of one walk is structure as well, and so is what is chance where a robot stands: only more
than that is called unexplained. So is a rest far beyond it, foretold or not. What one joint has in
stance or in swing is looked at by itself, as the mean over eighteen joints hides it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .features import Features, RobotKind
from .fit import RobotFit
from .model import ENGINES_RAD, RobotModel

Floats = NDArray[np.float64]
#: what is left, what others foretell of it [rad], what rounding of both has in common [rad^2], and
#: what is chance where robots stand [rad^2]
Foretold = tuple[Floats, Floats, Floats, Floats]
Row = tuple[Features, Foretold]  #: of a recording

#: times what engines differ by, from which structure is called unexplained; nulls have 0.5
MORE = 1.0
#: times the same of one joint in one phase. Eleven nulls of two other engines had 0.7 to 1.4 in the
#: worst of their places, and one of them 2.2, of which less than two fifths were foretold
LOCAL = 2.5
LOCAL_SHARE = 0.5  #: of one joint's squared rest in one phase that must be foretold; assumed
MISFIT = 3.0  #: times the same that a rest may be before it is unexplained, foretold or not
SHARE = 0.15  #: of the squared rest that must be foretold
AGREEING = 0.6  #: of the recordings that must agree


@dataclass(frozen=True, slots=True)
class Place:
    """What is left of one joint in one phase of the gait, as :class:`Rest` has it of all."""

    joint: str
    phase: str
    predicted_rad: float
    share: float
    agreeing: float
    sound_rad: float = ENGINES_RAD  #: that sound models leave

    @property
    def structured(self) -> bool:
        """Whether that alone must be called unexplained."""
        return _beyond(self, LOCAL, LOCAL_SHARE)


@dataclass(frozen=True, slots=True)
class Rest:
    """What is left: RMS of phase means [rad], how much is foretold, and what it goes with."""

    rms_rad: float
    predicted_rad: float
    share: float
    agreeing: float  #: share of the recordings whose rest goes the way that was foretold
    terms: Mapping[str, float]  #: correlations
    joints: tuple[str, ...]  #: the kinds of joints and phases that hold most of it
    where: tuple[str, ...]
    places: tuple[Place, ...] = ()  #: every joint in stance and in swing, the most foretold first
    sound_rad: float = ENGINES_RAD  #: that sound models leave

    @property
    def local(self) -> tuple[Place, ...]:
        """Joints in stance or swing that by themselves have more than noise and engines leave."""
        return tuple(place for place in self.places if place.structured)

    @property
    def everywhere(self) -> bool:
        """Whether all joints together have more than noise and engines leave."""
        return self.rms_rad > MISFIT * self.sound_rad or _beyond(self, MORE, SHARE)

    @property
    def structured(self) -> bool:
        """Whether it must be called unexplained."""
        return self.everywhere or bool(self.local)

    def told(self) -> tuple[Mapping[str, Any], ...]:
        """As ``diagnosis.json`` has it: of all joints, and of each that stands out by itself."""
        one = [] if self.local and not self.everywhere else [self._all()]
        by_joint: dict[str, list[Place]] = {}
        for place in self.local:
            by_joint.setdefault(place.joint, []).append(place)
        return (*one, *(_row(*most) for most in by_joint.values()))

    def _all(self) -> Mapping[str, Any]:
        return {
            "channel": "present_position",
            "joints": list(self.joints),
            "predictable_rad": self.predicted_rad,
            "share": self.share,
            "where": list(self.where),
            "terms": dict(self.terms),
        }

    @property
    def foretold(self) -> float:
        """The square of what is foretold, where that is no noise [rad^2]."""
        return self.predicted_rad**2 if self.structured else 0.0


def _beyond(part: Place | Rest, times: float, share: float) -> bool:
    """Whether so much more than sound models leave is foretold, and so much of what is left."""
    enough = part.predicted_rad > times * part.sound_rad and part.share > share
    return enough and part.agreeing >= AGREEING


def _row(most: Place, *others: Place) -> Mapping[str, Any]:
    """Places of one joint, the most foretold first, as ``diagnosis.json`` has them."""
    return {
        "channel": "present_position",
        "joints": [most.joint],
        "predictable_rad": most.predicted_rad,
        "share": most.share,
        "where": [most.phase, *(place.phase for place in others)],
        "terms": {},
    }


def rest_of(
    model: RobotModel, found: RobotFit, fitted: Sequence[int], judging: Sequence[int]
) -> Rest:
    """The rest of some recordings as others foretell it; of the same ones by each other."""
    blocks = model.residuals(found.names, found.z, sorted({*fitted, *judging}))
    left = {r: blocks[r, RobotKind.JOINTS].value for r in sorted({*fitted, *judging})}
    rows: list[Row] = []
    for r in judging:
        others = [q for q in fitted if q != r and _same_bins(model, q, r)]
        if not others:
            continue
        features = model.features[r]
        foretold, counts = np.zeros(len(left[r])), np.zeros(len(left[r]))
        for q in others:
            source = model.features[q]
            foretold += _as_rows(source, left[q], features) / len(others)
            counts += _as_rows(source, source.rounding_rad2, features) / len(others)
        common = np.minimum(counts, features.rounding_rad2)
        rows.append((features, (left[r], foretold, common, model.chance(r))))
    every = np.concatenate([left[r] for r in judging])
    rms = float(np.sqrt(np.mean(every**2)))
    sound = _sound_rad([model.chance(r) for r in judging])
    if not rows:
        return Rest(rms, 0.0, 0.0, 0.0, {}, (), (), sound_rad=sound)
    part, phases = _most(model, rows)
    return Rest(
        rms,
        *_foretold([row for _, row in rows]),
        _terms(rows),
        part,
        phases,
        _places(model, rows),
        sound,
    )


def _sound_rad(chance: Sequence[Floats]) -> float:
    """What sound models leave [rad]: what engines differ by, and chance."""
    return float(np.sqrt(ENGINES_RAD**2 + np.mean(np.concatenate(chance))))


def _foretold(rows: Sequence[Foretold]) -> tuple[float, float, float]:
    """RMS of what is foretold [rad], its share, and the share of recordings that agree.

    Joints that stand in the same place are rounded to the same count: that foretells nothing.
    """
    products = [float(np.mean(value * foretold - common)) for value, foretold, common, _ in rows]
    squares = [float(np.mean(value**2)) for value, *_ in rows]
    predicted = max(0.0, float(np.mean(products)))
    share = predicted / max(float(np.mean(squares)), 1e-30)
    return float(np.sqrt(predicted)), share, float(np.mean([x > 0.0 for x in products]))


def _places(model: RobotModel, rows: Sequence[Row]) -> tuple[Place, ...]:
    """Every joint in stance and in swing by itself, the most foretold first."""
    found = []
    for j, joint in enumerate(model.base.joints):
        for phase, stands in (("stance", True), ("swing", False)):
            own = [
                (value[here], foretold[here], common[here], chance[here])
                for features, (value, foretold, common, chance) in rows
                if (here := (features.joint_row == j) & (features.stance == stands)).any()
            ]
            if own:
                sound = _sound_rad([chance for *_, chance in own])
                found.append(Place(joint.name, phase, *_foretold(own), sound))
    return tuple(sorted(found, key=lambda place: -place.predicted_rad))


def _same_bins(model: RobotModel, one: int, other: int) -> bool:
    """Whether bins mean the same: both of a gait's phase, or windows of one motion, loads aside."""
    a, b = model.features[one], model.features[other]
    return (a.phase is not None and b.phase is not None) or a.shows(b) or b.shows(a)


def _as_rows(source: Features, value: Floats, target: Features) -> Floats:
    """Values by joint and bin in another recording's rows; 0 where there are none."""
    size = int(max(source.bin.max(), target.bin.max())) + 1
    table = np.zeros((int(target.joint_row.max()) + 1, size))
    table[source.joint_row, source.bin] = value
    found: Floats = table[target.joint_row, target.bin]
    return found


def _terms(rows: Sequence[Row]) -> dict[str, float]:
    """Correlations of the rest with what a joint does and bears, the strongest first."""
    value = np.concatenate([left for _, (left, *_) in rows])
    goal = np.concatenate([f.goal_rad for f, _ in rows])
    error = np.concatenate([f.goal_rad - f.position_rad for f, _ in rows])
    speed = np.concatenate([_speed(f) for f, _ in rows])
    stance = np.concatenate([f.stance.astype(np.float64) for f, _ in rows])
    terms = {"position": goal, "velocity": speed, "load": error, "stance": stance}
    found = {
        name: float(np.corrcoef(value, term)[0, 1]) if np.std(term) > 0.0 else 0.0
        for name, term in terms.items()
    }
    strong = sorted(found.items(), key=lambda item: -abs(item[1]))
    return {name: x for name, x in strong if abs(x) > 0.2}


def _speed(features: Features) -> Floats:
    """How the recorded means move from bin to bin [rad], round the cycle."""
    found = np.zeros(len(features.bin))
    for joint in range(int(features.joint_row.max()) + 1):
        mine = features.joint_row == joint
        angle = features.position_rad[mine]
        found[mine] = 0.5 * (np.roll(angle, -1) - np.roll(angle, 1))
    return found


def _most(model: RobotModel, rows: Sequence[Row]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The kind of joint that holds most of the rest, and the phases beyond an even share."""
    names = [joint.name for joint in model.base.joints]
    parts = np.array([name.rpartition(".")[2] for name in names])
    squares: dict[str, float] = {}
    phases = {"stance": (0.0, 0), "swing": (0.0, 0)}
    for features, (value, *_) in rows:
        of_row = parts[features.joint_row]
        for part in dict.fromkeys(parts.tolist()):
            squares[part] = squares.get(part, 0.0) + float(np.sum(value[of_row == part] ** 2))
        for phase, there in (("stance", features.stance), ("swing", ~features.stance)):
            total, count = phases[phase]
            phases[phase] = total + float(np.sum(value[there] ** 2)), count + int(there.sum())
    most = max(squares, key=lambda part: squares[part])
    level = {phase: total / max(count, 1) for phase, (total, count) in phases.items()}
    where = [phase for phase, x in level.items() if x >= float(np.mean(list(level.values())))]
    return tuple(n for n in names if n.endswith(f".{most}")), tuple(where)
