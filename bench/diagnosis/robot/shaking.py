"""How much joints shake from sample to sample, which means over the phase of the gait do not show.

A leg with play is thrown from flank to flank while it swings. When is chance, so phase means have
it as noise; how much is not, and two sound engines agree about it. So a recording has numbers of
its own for it: two a joint, while its leg is told to stand and while it is told to swing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: by which two engines and two specimens differ about a number, one deviation. Measured of plain
#: replays of walks by two other engines, without play: kinds of joints are up to 0.02 off, and 0.04
#: where sensors have a quarter of a count of noise
ENGINES_SHAKING = 0.03
#: between two samples [s], beyond which differences are the motion's. Measured of robots of a third
#: engine: rows of samples 22 to 34 ms apart are 0.01 to 0.04 off, of 83 and 90 ms 0.1
SELDOM_S = 0.05
EVEN = 1.5  #: times the usual wait between two samples, beyond which a difference says nothing
#: differences that are left out where they were recorded, as wrong packets make such: no play
#: throws a joint farther; and of the others a share of the largest
GLITCH_RAD, GLITCHES = 0.1, 0.02
MOVES = 0.1  #: share of a row that would be left out from which it is the motion itself: no row
BESIDE = 1.0  #: count beside which joints shake: a sensor may have a quarter of noise, or none
PHASES = ("stance", "swing")


@dataclass(frozen=True, slots=True, eq=False)
class Shaking:
    """Of every joint, of each three samples the middle one's time [s], and its phase.

    ``phase`` counts :data:`PHASES`, -1 where samples are uneven or wrong, the robot does not walk
    yet, or samples are so far apart that it moves as far as no play throws it.
    """

    t_s: tuple[Floats, ...]
    phase: tuple[NDArray[np.intp], ...]
    quantum_rad: float

    @classmethod
    def of(
        cls,
        sample_s: Sequence[Floats],
        angle_rad: Sequence[Floats],
        lifted: Sequence[Bools],
        steady: Sequence[Bools],
        quantum_rad: float,
    ) -> Shaking:
        """From joints' samples, whether their legs are told to swing then, and robots walk."""
        phases = []
        for t, angle, up, walks in zip(sample_s, angle_rad, lifted, steady, strict=True):
            waits = np.diff(t)
            usual = np.median(waits) if len(waits) else 0.0
            even = (np.maximum(waits[1:], waits[:-1]) < EVEN * usual) & (usual <= SELDOM_S)
            phase = np.where(even & walks[1:-1], up[1:-1].astype(np.intp), -1)
            phases.append(_without_wrong(phase, np.abs(np.diff(angle, 2)) >= GLITCH_RAD))
        return cls(tuple(t[1:-1] for t in sample_s), tuple(phases), quantum_rad)

    def rows(
        self, angle_rad: Sequence[Floats], span: tuple[float, float] = (-np.inf, np.inf)
    ) -> Floats:
        """Logarithms of how much joints shake, (joints x phases,); NaN where a leg never is.

        RMS of second differences, in counts as a register has them, over the square root of 6, so
        that white noise has its own deviation.
        """
        found = []
        for angle, t, phase in zip(angle_rad, self.t_s, self.phase, strict=True):
            apart = np.diff(np.round(angle / self.quantum_rad), 2)
            squares = apart**2 / 6.0
            inside = (t >= span[0]) & (t <= span[1])
            found += [_log(squares[inside & (phase == k)]) for k in range(len(PHASES))]
        return np.array(found)


def _without_wrong(phase: NDArray[np.intp], far: Bools) -> NDArray[np.intp]:
    """Phases without what wrong packets make, and none of which the motion is as large."""
    kept = np.where(far, -1, phase)
    for k in range(len(PHASES)):
        own = phase == k
        if far[own].sum() >= MOVES * own.sum():
            kept[own] = -1
    return kept


def _log(squares: Floats) -> float:
    kept = np.sort(squares)[: round((1.0 - GLITCHES) * len(squares))]
    return 0.5 * float(np.log(np.mean(kept) + BESIDE**2)) if len(kept) else float("nan")


def by_kind(joints: Sequence[str], rows: Floats) -> dict[str, float]:
    """Means of rows over the legs, by ``"coxa swing"`` and so on."""
    kinds = [f"{joint.rpartition('.')[2]} {phase}" for joint in joints for phase in PHASES]
    own = {
        kind: [x for k, x in zip(kinds, rows.tolist(), strict=True) if k == kind] for kind in kinds
    }
    return {kind: float(np.nanmean(some)) for kind, some in own.items() if not np.isnan(some).all()}
