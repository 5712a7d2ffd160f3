"""Where a whole robot's misfit lives: which joints, standing or swinging."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .fit import Fit
from .robot_features import RobotKind
from .robot_model import RobotModel

Floats = NDArray[np.float64]

DRAWS = 2000  #: of shifts of the phase, for p-values


@dataclass(frozen=True, slots=True)
class RobotPlace:
    """Joints of one kind in stance or swing.

    ``share`` of the whole misfit's squares, ``mean_rad`` and ``rms_rad`` of recorded less modelled.
    ``p_value``: how often as much would lie there if the misfit knew no phase (whole courses of
    joints shifted at random against stance and swing), times the number of places looked at.
    """

    part: str
    phase: str
    joints: tuple[str, ...]
    share: float
    mean_rad: float
    rms_rad: float
    p_value: float


def places(model: RobotModel, found: Fit, which: Sequence[int], seed: int = 0) -> list[RobotPlace]:
    """Kinds of joints by stance and swing, the largest share first; a hexapod that walks."""
    (blocks,) = model.residuals(found.hypothesis, [found.z], which)
    names = [joint.name for joint in model.base.joints]
    random = np.random.default_rng(seed)
    squares: dict[tuple[str, str], float] = {}
    shuffled: dict[tuple[str, str], Floats] = {}
    rows: dict[tuple[str, str], list[Floats]] = {}
    for r in which:
        features = model.features[r]
        value = blocks[r, RobotKind.JOINTS].value
        for j, joint in enumerate(names):
            mine = features.joint_row == j
            part = joint.rpartition(".")[2]
            stance, course = features.stance[mine], value[mine]
            shifts = random.integers(len(course), size=DRAWS)
            for phase, there in (("stance", stance), ("swing", ~stance)):
                key = part, phase
                rows.setdefault(key, []).append(course[there])
                squares[key] = squares.get(key, 0.0) + float(np.sum(course[there] ** 2))
                rolled = np.stack([np.roll(course**2, k) for k in range(len(course))])
                sums = rolled[:, there].sum(axis=1)[shifts]
                shuffled[key] = shuffled.get(key, np.zeros(DRAWS)) + sums
    total = sum(squares.values()) or 1.0
    result = []
    for (part, phase), sum_of in squares.items():
        values = np.concatenate(rows[part, phase])
        by_chance = (1.0 + float(np.sum(shuffled[part, phase] >= sum_of))) / (1.0 + DRAWS)
        result.append(
            RobotPlace(
                part,
                phase,
                tuple(name for name in names if name.endswith(f".{part}")),
                sum_of / total,
                float(np.mean(values)) if len(values) else 0.0,
                float(np.sqrt(np.mean(values**2))) if len(values) else 0.0,
                min(1.0, by_chance * len(squares)),
            )
        )
    return sorted(result, key=lambda place: -place.share)
