"""MuJoCo's way: its own rollouts, and its own least squares with what ``mujoco.sysid`` hands it.

The one module of this package that knows the engine.
"""

from __future__ import annotations

import copy
import math
import os
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco import minimize, rollout
from numpy.typing import NDArray

from bench.diagnosis.joint.model import Hypothesis
from bench.diagnosis.observed import Observed
from sim.drive import fields
from sim.stepped import TICK_S

from .problem import Plain, Problem, SameModel
from .replays import Replayed, Residuals

Floats = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
BALLAST_KG = 10.0  #: any mass will do: it makes gravity's torque by where its centre is
#: of dry friction: as stiff as the engine's time step lets it be, so that a held joint stays
SOLREF, SOLIMP = (2.0 * TICK_S, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
MOST_STEPS = 200  #: source: mujoco.sysid, ``max_iters``
STEP = float(np.finfo(np.float64).eps ** 0.5)  #: source: mujoco.minimize, ``eps``
#: a step that dry friction's roughness does not hide; the shortest of those tried (1e-4, 1e-2)
LONG_STEP = 1e-4


class MujocoReplay(Replayed):
    """MuJoCo's: one model a candidate and recording, rolled out together, a tick a step.

    Where friction grows with load, one after another, with a call from Python before every step.
    """

    def __init__(self, model: SameModel, hypothesis: Hypothesis) -> None:
        super().__init__(model, hypothesis, TICK_S)
        self._goals = np.stack([_held(one, self.t_s[:-1]) for one in self.observed])
        self._bare = [
            mujoco.MjModel.from_xml_string(_document(plain))
            for plain in self.plain(np.zeros(len(hypothesis.knobs)))
        ]
        self._data = [mujoco.MjData(self._bare[0]) for _ in range(len(os.sched_getaffinity(0)))]
        self._called = any(knob.effect == "load_friction" for knob in hypothesis.knobs)

    def __call__(self, vectors: Sequence[Floats]) -> list[Floats]:
        """Residuals of every vector [rad]."""
        told = [self.plain(z) for z in vectors]
        roll = self._stepped if self._called else self._rolled
        shafts = roll([plain for row in told for plain in row])
        count = len(self.observed)
        return [
            self.residual(shafts[v * count : (v + 1) * count], row) for v, row in enumerate(told)
        ]

    def _models(self, told: Sequence[Plain]) -> list[Any]:
        models = []
        for k, plain in enumerate(told):
            model = copy.copy(self._bare[k % len(self._bare)])
            stiffness = plain.gain * plain.stall_nm
            model.actuator_gainprm[0, 0] = stiffness
            model.actuator_biasprm[0, :2] = -stiffness * plain.zero_rad, -stiffness
            most = plain.limit * plain.stall_nm
            model.actuator_forcerange[0] = -most, most
            model.dof_damping[0] = plain.viscous_nm_s + plain.emf_nm_s
            model.dof_frictionloss[0] = max(plain.coulomb_nm, 1e-9)
            model.dof_armature[0] = plain.rotor_kg_m2
            models.append(model)
        return models

    def _rolled(self, told: Sequence[Plain]) -> list[Floats]:
        states = np.array([[0.0, plain.start_rad, plain.start_rad_s] for plain in told])
        goals = np.tile(self._goals, (len(told) // len(self._goals), 1))[:, :, None]
        found, _ = rollout.rollout(self._models(told), self._data, states, goals)
        return [
            np.concatenate([[plain.start_rad], state[:, 1]])
            for plain, state in zip(told, found, strict=True)
        ]

    def _stepped(self, told: Sequence[Plain]) -> list[Floats]:
        return [
            self._steps(model, plain, self._goals[k % len(self._goals)].tolist())
            for k, (model, plain) in enumerate(zip(self._models(told), told, strict=True))
        ]

    def _steps(self, model: Any, plain: Plain, goals: Sequence[float]) -> Floats:
        data, step = mujoco.MjData(model), mujoco.mj_step
        data.qpos[0], data.qvel[0] = plain.start_rad, plain.start_rad_s
        angle, speed, dry, control = data.qpos, data.qvel, model.dof_frictionloss, data.ctrl
        stall, emf, gain, limit = plain.stall_nm, plain.emf_nm_s, plain.gain, plain.limit
        zero, load, coulomb = plain.zero_rad, plain.load, max(plain.coulomb_nm, 1e-9)
        sine, cosine = plain.sine_nm, plain.cosine_nm
        shaft = [plain.start_rad]
        for goal in goals:
            q = shaft[-1]
            duty = min(limit, max(-limit, gain * (goal - q - zero)))
            motor = stall * duty - emf * speed.item(0)
            gravity = cosine * math.cos(q) - sine * math.sin(q)
            dry[0] = coulomb + load * abs(motor - gravity)
            control[0] = goal
            step(model, data)
            shaft.append(angle.item(0))
        return np.array(shaft)


def _held(one: Observed, t_s: Floats) -> Floats:
    """The goal that holds at some instants."""
    events = one.replay.events[one.replay.events[:, 1] == fields.GOAL_POSITION]
    goals = np.concatenate([one.replay.start[[fields.GOAL_POSITION]], events[:, 2]])
    held: Floats = goals[np.searchsorted(events[:, 0], t_s + 1e-9, side="right")]
    return held


def _document(plain: Plain) -> str:
    """A hinge about +y with a weight that has the inertia and the torque of gravity wanted."""
    weight = BALLAST_KG * GRAVITY_M_S2
    x, z = plain.cosine_nm / weight, -plain.sine_nm / weight
    own = plain.inertia_kg_m2 - BALLAST_KG * (x * x + z * z)
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{TICK_S!r}" '
        f'integrator="implicitfast" gravity="0 0 {-GRAVITY_M_S2!r}">'
        '<flag contact="disable"/></option><worldbody><body>'
        f'<joint name="arm" type="hinge" axis="0 1 0" frictionloss="1e-9" '
        f'solreffriction="{SOLREF[0]!r} {SOLREF[1]!r}" '
        f'solimpfriction="{" ".join(map(repr, SOLIMP))}"/>'
        f'<inertial pos="{x!r} 0 {z!r}" mass="{BALLAST_KG!r}" '
        f'diaginertia="{" ".join([repr(own)] * 3)}"/>'
        '</body></worldbody><actuator><general joint="arm" biastype="affine" forcelimited="true" '
        'forcerange="-1 1" gainprm="1" biasprm="0 -1 0"/></actuator></mujoco>'
    )


def by_differences(problem: Problem, replay: Residuals, step: float = STEP) -> Floats:
    """MuJoCo's own least squares within the box, with what ``mujoco.sysid`` hands it.

    ``step`` is that of the differences, in typical sizes of the numbers.
    """
    scale = float(np.sqrt(np.mean(_recorded(problem.fitted) ** 2)))

    def residual(columns: Floats) -> Floats:
        found = replay([column.copy() for column in np.atleast_2d(columns.T)])
        return np.stack(found, axis=1) / scale

    z, _ = minimize.least_squares(
        problem.start,
        residual,
        bounds=list(problem.box),
        eps=step,
        max_iter=MOST_STEPS,
        verbose=minimize.Verbosity.SILENT,
    )
    return np.asarray(z, np.float64).reshape(-1)


def _recorded(model: SameModel) -> Floats:
    seen = (one.position for one in model.observed)
    return np.concatenate([samples.value[samples.good] for samples in seen])
