"""Where a whole robot's misfit lives: which joints, standing or swinging."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

from .robot_features import RobotKind
from .robot_fit import RobotFit
from .robot_model import RobotModel

#: neighbouring bins of a phase err together: so many of them tell as much as one; assumed
TOGETHER = 4.0
SIGNIFICANT = 0.05
STANDS_OUT = 3.0  #: times the middle leg's, from which a leg's misfit is told on its own


def mismatch(
    model: RobotModel, found: RobotFit, which: Sequence[int]
) -> tuple[dict[str, Any], ...]:
    """Where more is left than noise leaves, as ``diagnosis.json`` has it, the largest share first.

    A place is a joint in stance or swing; those of one kind stand together, but legs that stand
    out stand on their own. ``p_value`` is the chance of as much from noise and from what two
    engines differ by, times the number of places.
    """
    blocks = model.residuals(found.names, found.z, which)
    names = [joint.name for joint in model.base.joints]
    floor = model.floors()[RobotKind.JOINTS] ** 2
    sums: dict[tuple[str, str], float] = {}
    ratios: dict[tuple[str, str], float] = {}
    counts: dict[tuple[str, str], int] = {}
    for r in which:
        features, block = model.features[r], blocks[r, RobotKind.JOINTS]
        for j, joint in enumerate(names):
            for phase, stands in (("stance", True), ("swing", False)):
                there = (features.joint_row == j) & (features.stance == stands)
                key = joint, phase
                square = block.value[there] ** 2
                sums[key] = sums.get(key, 0.0) + float(square.sum())
                ratio = float((square / (floor + block.extra[there])).sum())
                ratios[key] = ratios.get(key, 0.0) + ratio
                counts[key] = counts.get(key, 0) + int(there.sum())
    total = sum(sums.values()) or 1.0
    chance = {
        key: min(1.0, len(sums) * float(chi2.sf(ratios[key] / TOGETHER, counts[key] / TOGETHER)))
        for key in sums
        if counts[key]
    }
    rows = []
    for part in dict.fromkeys(name.rpartition(".")[2] for name in names):
        for phase in ("stance", "swing"):
            keys = [k for k in chance if k[0].endswith(f".{part}") and k[1] == phase]
            telling = [k for k in keys if chance[k] < SIGNIFICANT]
            usual = float(np.median([sums[k] / counts[k] for k in keys])) if keys else 0.0
            own = [k for k in telling if sums[k] / counts[k] > STANDS_OUT * usual]
            groups = [[k] for k in own] + [[k for k in telling if k not in own]]
            rows += [
                {
                    "channel": "present_position",
                    "joints": [joint for joint, _ in group],
                    "phase": phase,
                    "share": sum(sums[k] for k in group) / total,
                    "p_value": min(chance[k] for k in group),
                }
                for group in groups
                if group
            ]
    return tuple(sorted(rows, key=lambda row: -float(str(row["share"]))))
