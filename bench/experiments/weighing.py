"""A robot weighs itself: what its feet carry, by the torques of its joints.

A leg that stands still is in balance. At each of its joints the servo's torque, the weight of the
links beyond, and the ground's force on the foot cancel: ``torque + links + J^T force = 0``, ``J``
the Jacobian of the foot's lowest point. Three joints give the three parts of that force. What all
feet carry upwards is the weight of the robot and of what lies on it.

Which way is up is the normal of the plane through three feet, so the ground must be level and
flat. Masses, lengths and feet are the robot file's; all else is joint data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from busemu.tables import Robot
from hal.legs import PARTS
from sim.model import read_model
from sim.tree import GRAVITY_M_S2, PhysicalRobot

from ..recording import Recording
from .experiment import ExperimentError
from .position_error import TorqueSensor
from .series import Floats, observed, rms, samples

#: Feet that carry: three make a plane.
FEET = 3
#: How a torque is told: by the position law alone, with friction, and as it was.
DUTY, PAST_FRICTION, TRUE = "duty_x_stall", "past_friction", "true"


@dataclass(frozen=True, slots=True, eq=False)
class Weighing:
    """One recording's load on the trunk, by torques told in three ways (:data:`DUTY`, ...).

    ``load_kg``: courses of shape (samples,) at ``t_s``, NaN where those torques are not known.
    ``rmse_nm``: of the torques recovered in two ways against the true ones, by joint; NaN likewise.
    """

    true_load_kg: float  #: as the recording's condition says
    own_kg: float  #: mass of the robot by its file
    t_s: Floats
    load_kg: Mapping[str, Floats]
    rmse_nm: Mapping[str, Mapping[str, float]]

    def mean_kg(self, how: str) -> float:
        """The load by torques told in one way: the mean over the span [kg]."""
        return float(np.mean(self.load_kg[how]))


def weigh(
    recording: Recording,
    robot: Robot,
    legs: Sequence[str],
    span: tuple[float, float],
    true_load_kg: float,
) -> Weighing:
    """Weigh a robot that stands on three ``legs`` over ``span`` [s, host's clock].

    The mean is as good as friction is known: best while the joints turn slowly, either way alike.
    Raises :class:`ExperimentError`, ``RecordingError``, :class:`sim.entries.PhysicsError`.
    """
    if len(legs) != FEET:
        raise ExperimentError(
            f"{recording.name}: condition supporting = {list(legs)!r} must name {FEET} legs"
        )
    model = read_model(robot)
    joints = [f"{leg}.{part}" for leg in legs for part in PARTS]
    t_s: Floats = samples(recording, robot, joints[0], span).t_s
    angles_rad = np.empty((len(t_s), len(joints)))
    torques_nm = {how: np.empty_like(angles_rad) for how in (DUTY, PAST_FRICTION, TRUE)}
    for column, joint in enumerate(joints):
        sensor = TorqueSensor.of_recording(recording, robot, joint)
        # from the very beginning: friction goes by how the joint came to where it is
        found = samples(recording, robot, joint, (-np.inf, span[1]))
        angles_rad[:, column] = np.interp(t_s, found.t_s, found.position_rad)
        courses = {
            DUTY: sensor.torque_nm(found.error_rad, found.voltage_v),
            PAST_FRICTION: sensor.torque_past_friction_nm(
                found.error_rad, found.voltage_v, found.position_rad
            ),
        }
        for how, torque_nm in courses.items():
            torques_nm[how][:, column] = np.interp(t_s, found.t_s, torque_nm)
        torques_nm[TRUE][:, column] = observed(recording, f"rig/{joint}_nm", t_s)
    return Weighing(
        true_load_kg,
        model.mass_kg,
        t_s,
        {
            how: carried_n(model, legs, angles_rad, torque_nm).sum(axis=1) / GRAVITY_M_S2
            - model.mass_kg
            for how, torque_nm in torques_nm.items()
        },
        {
            how: {
                joint: rms(torques_nm[how][:, column] - torques_nm[TRUE][:, column])
                for column, joint in enumerate(joints)
            }
            for how in (DUTY, PAST_FRICTION)
        },
    )


def carried_n(
    model: PhysicalRobot, legs: Sequence[str], angles_rad: Floats, torques_nm: Floats
) -> Floats:
    """What each of three feet carries upwards [N]: shape (samples, 3).

    ``angles_rad`` and ``torques_nm``, of the servos on the joints, have a column a joint, leg by
    leg: shape (samples, 9). Up is away from the plane of the three feet, towards the trunk.
    """
    chains = [
        _Chain.of(model, leg, angles_rad[:, len(PARTS) * at : len(PARTS) * (at + 1)])
        for at, leg in enumerate(legs)
    ]
    one, other, third = (chain.foot_m for chain in chains)
    normal = np.cross(other - one, third - one)
    up = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    up *= np.sign(up[:, 2:])  # the trunk's z axis is up but for its lean
    return np.stack(
        [
            _foot_force_n(chain, up, torques_nm[:, len(PARTS) * at : len(PARTS) * (at + 1)])
            for at, chain in enumerate(chains)
        ],
        axis=1,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    """A leg's three bodies in the trunk's frame, over time; (samples, 3) each, from the body on."""

    joints_m: list[Floats]
    axes: list[Floats]
    centres_m: list[Floats]
    masses_kg: list[float]
    foot_m: Floats  #: centre of the foot's sphere
    foot_radius_m: float

    @classmethod
    def of(cls, model: PhysicalRobot, leg: str, angles_rad: Floats) -> _Chain:
        joints, axes, centres, masses = [], [], [], []
        turned = Rotation.identity(len(angles_rad))
        at: Floats = np.zeros((len(angles_rad), 3))
        for part, angle in zip(PARTS, angles_rad.T, strict=True):
            body = model.body(f"{leg}.{part}")
            at = at + turned.apply(body.at_m)
            yawed = turned * Rotation.from_rotvec((0.0, 0.0, body.yaw_rad))
            turned = yawed * Rotation.from_rotvec(np.outer(angle, body.axis))
            mass = model.mass_of(body)
            joints.append(at)
            axes.append(turned.apply(body.axis))
            centres.append(at + turned.apply(mass.centre_m))
            masses.append(mass.mass_kg)
        (own,) = (known for known in model.legs if known.name == leg)
        tip = at + turned.apply((own.lengths_m[PARTS[-1]], 0.0, 0.0))
        return cls(joints, axes, centres, masses, tip, own.foot.radius_m)


def _foot_force_n(chain: _Chain, up: Floats, torques_nm: Floats) -> Floats:
    """The ground's force on a foot along ``up`` [N], shape (samples,)."""
    touches_m = chain.foot_m - chain.foot_radius_m * up
    rows, loads = [], []
    for at, (joint_m, axis) in enumerate(zip(chain.joints_m, chain.axes, strict=True)):
        links_nm = sum(
            np.sum(axis * np.cross(centre_m - joint_m, -mass_kg * GRAVITY_M_S2 * up), axis=1)
            for centre_m, mass_kg in zip(chain.centres_m[at:], chain.masses_kg[at:], strict=True)
        )
        rows.append(np.cross(axis, touches_m - joint_m))
        loads.append(torques_nm[:, at] + links_nm)
    transposed = np.stack(rows, axis=1)
    force_n = np.linalg.solve(transposed, -np.stack(loads, axis=1)[:, :, np.newaxis])[:, :, 0]
    return np.asarray(np.sum(force_n * up, axis=1))
