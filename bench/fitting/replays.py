"""The same vector through other simulators: our kernel, and bam's loop in Python.

Each gives residuals (recorded less simulated, rad), all recordings one after another: those of
:func:`bench.fitting.problem.together`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bench.diagnosis.joint.model import Hypothesis

from .problem import Plain, SameModel, together

Floats = NDArray[np.float64]

LOOP_S = 0.005  #: of a step; source: bam/process.py, --dt
FASTEST_RAD_S = 100.0  #: that a joint can get; source: bam/simulate.py


class Residuals(Protocol):
    """A simulator of some recordings."""

    def __call__(self, vectors: Sequence[Floats]) -> list[Floats]:
        """Residuals of every vector [rad]."""


class KernelReplay:
    """The compiled batches of :mod:`sim.rollout`."""

    def __init__(self, model: SameModel, hypothesis: Hypothesis) -> None:
        self._model, self._hypothesis = model, hypothesis

    def __call__(self, vectors: Sequence[Floats]) -> list[Floats]:
        """Residuals of every vector [rad]."""
        return [together(found) for found in self._model.residuals(self._hypothesis, vectors)]


class Replayed:
    """What is read off a model once: goals on a grid, and where each recording was sampled."""

    def __init__(self, model: SameModel, hypothesis: Hypothesis, step_s: float) -> None:
        self._model, self._hypothesis = model, hypothesis
        self._step_s = step_s
        self.observed = model.observed
        end_s = max(one.replay.end_s for one in self.observed)
        self.t_s: Floats = np.arange(math.ceil(end_s / step_s) + 1, dtype=np.float64) * step_s

    def plain(self, z: Floats) -> list[Plain]:
        """What a vector makes of the joint in every recording."""
        return [
            Plain.of(self._model.candidate(self._hypothesis, z, r), one.replay)
            for r, one in enumerate(self.observed)
        ]

    def residual(self, shafts: Sequence[Floats], told: Sequence[Plain]) -> Floats:
        """Residuals of the shafts' angles [rad] at every instant of the grid, by recording."""
        found = []
        for one, shaft, plain in zip(self.observed, shafts, told, strict=True):
            seen = one.position
            at = seen.t_s[seen.good]
            sensed = np.interp(at, self.t_s, shaft) + plain.zero_rad
            found.append(seen.value[seen.good] - sensed)
        return np.concatenate(found)


class LoopReplay(Replayed):
    """bam's: a step of 5 ms after another in Python, the recordings side by side in arrays."""

    def __init__(self, model: SameModel, hypothesis: Hypothesis) -> None:
        super().__init__(model, hypothesis, LOOP_S)
        self._goals = np.stack([np.interp(self.t_s, *one.goal) for one in self.observed], axis=1)

    def __call__(self, vectors: Sequence[Floats]) -> list[Floats]:
        """Residuals of every vector [rad]."""
        return [self._one(z) for z in vectors]

    def _one(self, z: Floats) -> Floats:
        told = self.plain(z)

        def column(name: str) -> Floats:
            return np.array([getattr(plain, name) for plain in told])

        stall, emf, gain, limit = map(column, ("stall_nm", "emf_nm_s", "gain", "limit"))
        inertia = column("inertia_kg_m2") + column("rotor_kg_m2")
        coulomb, viscous, load = map(column, ("coulomb_nm", "viscous_nm_s", "load"))
        sine, cosine, zero = map(column, ("sine_nm", "cosine_nm", "zero_rad"))
        angle, speed = column("start_rad"), column("start_rad_s")
        shafts = np.empty_like(self._goals)
        for k, goal in enumerate(self._goals):
            shafts[k] = angle
            duty = np.clip(gain * (goal - angle - zero), -limit, limit)
            motor = stall * duty - emf * speed
            gravity = cosine * np.cos(angle) - sine * np.sin(angle)
            level = coulomb + viscous * np.abs(speed) + load * np.abs(motor - gravity)
            stop = inertia / LOOP_S * speed + motor + gravity
            net = motor + gravity - np.sign(stop) * np.minimum(np.abs(stop), level)
            speed = np.clip(speed + net / inertia * LOOP_S, -FASTEST_RAD_S, FASTEST_RAD_S)
            angle = angle + speed * LOOP_S
        return self.residual(list(shafts.T), told)
