"""Where a whole robot's misfit lives: which joints, standing or swinging."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from .features import RobotKind
from .model import RobotModel

Floats = NDArray[np.float64]

#: neighbouring bins of a phase err together: so many of them tell as much as one; assumed
TOGETHER = 4.0
SIGNIFICANT = 0.05
STANDS_OUT = 3.0  #: times the middle leg's, from which a leg's misfit is told on its own
LEAST = 0.1  #: of the most moved of a kind, from which a joint counts as moved with it
WORTH = 0.02  #: of all that what is named moves, from which a place of it is told
Key = tuple[str, str]  #: a joint and a phase


class Places:
    """Squares of something that is in rows of joints, by joint and phase.

    Rows are by the number of a recording. A leg stands where its foot presses in the last exact
    replay, not where it is told to.
    ``ratio`` is the same over what noise and two engines make of it.
    """

    def __init__(self, model: RobotModel, rows: Mapping[int, Floats]) -> None:
        self.names = [joint.name for joint in model.base.joints]
        floor = model.floors()[RobotKind.JOINTS] ** 2
        self.sums: dict[Key, float] = {}
        self.ratios: dict[Key, float] = {}
        self.counts: dict[Key, float] = {}
        for r, value in rows.items():
            features = model.features[r]
            extra = model.block(r, RobotKind.JOINTS, value).scatter
            stance = model.pressed(r)
            for j, joint in enumerate(self.names):
                own = features.joint_row == j
                for phase, share in (("stance", stance[own]), ("swing", 1.0 - stance[own])):
                    key = joint, phase
                    square = share * value[own] ** 2
                    self.sums[key] = self.sums.get(key, 0.0) + float(square.sum())
                    ratio = float((square / (floor + extra[own])).sum())
                    self.ratios[key] = self.ratios.get(key, 0.0) + ratio
                    self.counts[key] = self.counts.get(key, 0.0) + float(share.sum())

    def chance(self, *keys: Key) -> float:
        """Of as much from noise and from what two engines differ by, times the places.

        Of several, of as much in all of them together.
        """
        count, ratio = (sum(each[k] for k in keys) for each in (self.counts, self.ratios))
        return min(1.0, len(self.sums) * float(chi2.sf(ratio / TOGETHER, count / TOGETHER)))

    def level(self, key: Key) -> float:
        """The mean square of one."""
        return self.sums[key] / self.counts[key]

    def kinds(self) -> list[list[Key]]:
        """Joints of one kind in one phase stand together."""
        parts = dict.fromkeys(name.rpartition(".")[2] for name in self.names)
        seen = [key for key in self.sums if self.counts[key]]
        found = [
            [k for k in seen if k[0].endswith(f".{part}") and k[1] == phase]
            for part in parts
            for phase in ("stance", "swing")
        ]
        return [keys for keys in found if keys]

    def most(self, keys: Sequence[Key]) -> list[Key]:
        """Of joints of one kind those that are not far below the one that is farthest off."""
        most = max((self.level(k) for k in keys), default=0.0)
        return [k for k in keys if self.level(k) >= LEAST * most]

    def row(self, group: Sequence[Key]) -> dict[str, Any]:
        """A group as ``diagnosis.json`` has it."""
        total = sum(self.sums.values()) or 1.0
        return {
            "channel": "present_position",
            "joints": [joint for joint, _ in group],
            "phase": group[0][1],
            "share": sum(self.sums[k] for k in group) / total,
            "p_value": min(self.chance(*group), *(self.chance(k) for k in group)),
        }


def mismatch(model: RobotModel, left: Mapping[int, Floats]) -> tuple[dict[str, Any], ...]:
    """Where more is left than noise leaves, as ``diagnosis.json`` has it, the largest share first.

    ``left`` is what is left of recordings, by their numbers. A place is a joint in stance or swing;
    those of one kind stand together, but legs that stand out stand on their own. What is in all
    joints of a kind may be too little in each, and tells by all of them. ``p_value`` is
    the chance of as much from noise and from two engines, times the number of places looked at.
    """
    places = Places(model, left)
    rows = []
    for keys in places.kinds():
        telling = [k for k in keys if places.chance(k) < SIGNIFICANT]
        usual = float(np.median([places.level(k) for k in keys]))
        own = [k for k in telling if places.level(k) > STANDS_OUT * usual]
        rest = [k for k in keys if k not in own]
        together = places.most(rest) if rest and places.chance(*rest) < SIGNIFICANT else []
        groups = [[k] for k in own] + [[k for k in rest if k in telling or k in together]]
        rows += [places.row(group) for group in groups if group]
    return tuple(sorted(rows, key=lambda row: -float(row["share"])))


def moved(model: RobotModel, by: Mapping[int, Floats]) -> tuple[dict[str, Any], ...]:
    """Where what is named moves a robot, as ``diagnosis.json`` has it, the largest share first.

    ``by`` is how far it moves the rows of recordings. That it is there at all is shown by all of
    them together, so that a place is told whether or not it would show it alone: ``p_value`` may be
    any. Told by that, what is spread over a gait would seem to be where feet press alone.
    """
    places = Places(model, by)
    rows = []
    for keys in places.kinds():
        row = places.row(places.most(keys))
        if row["share"] >= WORTH:
            rows.append(row)
    return tuple(sorted(rows, key=lambda row: -float(row["share"])))
