"""Rigs in MuJoCo, behind the same drives: a second opinion on PyBullet. ``python`` draws it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from busemu.plant import DriveCommand
from busemu.tables import Robot, load_robot
from sim.model import read_model
from sim.stepped import TICK_S, SteppedPlant
from sim.tree import PhysicalRobot
from sim.watch import Contacts
from sim.world import BulletPlant

LAW = {"gain_cw_per_rad": 5.0, "gain_ccw_per_rad": 5.0}


class MujocoWorld:
    """A rig without contacts in MuJoCo; an engine of :mod:`sim.stepped`.

    With PyBullet's semi-implicit Euler, or ``fine``: Runge and Kutta's of fourth order.
    """

    def __init__(self, robot: PhysicalRobot, *, step_s: float, fine: bool = False) -> None:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        spec.option.timestep = step_s
        euler, rk4 = mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4
        spec.option.integrator = rk4 if fine else euler
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        spec.option.gravity = robot.ground.gravity_m_s2
        limits = {joint.name: (joint.lower_rad, joint.upper_rad) for joint in robot.joints}
        placed: dict[str | None, Any] = {None: spec.worldbody}
        for body in robot.bodies:
            mass = robot.mass_of(body)
            xx, yy, zz, xy, xz, yz = mass.inertia_kg_m2
            link = placed[body.parent].add_body(
                name=body.name,
                pos=body.at_m,
                quat=[np.cos(body.yaw_rad / 2), 0.0, 0.0, np.sin(body.yaw_rad / 2)],
                mass=mass.mass_kg,
                ipos=mass.centre_m,
                fullinertia=[xx, yy, zz, xy, xz, yz],
                explicitinertial=True,
            )
            link.add_joint(
                name=body.name,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=body.axis,
                range=limits[body.name],
                limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            )
            placed[body.name] = link
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        ids = [self.model.joint(joint.name).id for joint in robot.joints]
        self._angles = self.model.jnt_qposadr[ids]
        self._rates = self.model.jnt_dofadr[ids]
        self.place(robot.posture(robot.rest_rad), [joint.name for joint in robot.joints])

    def place(self, joints_rad: dict[str, float], order: list[str]) -> None:
        self.data.qpos[self._angles] = [joints_rad[name] for name in order]
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def inverse_mass(self) -> np.ndarray:
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        inverse: np.ndarray = np.linalg.inv(full)[np.ix_(self._rates, self._rates)]
        return inverse

    def read(self, position_rad: np.ndarray, velocity_rad_s: np.ndarray) -> None:
        position_rad[:] = self.data.qpos[self._angles]
        velocity_rad_s[:] = self.data.qvel[self._rates]

    def step(self, torque_nm: np.ndarray) -> None:
        self.data.qfrc_applied[self._rates] = torque_nm
        mujoco.mj_step(self.model, self.data)

    def observe(self) -> dict[str, float]:
        return {}

    def contacts(self) -> Contacts:
        return Contacts()

    def lean_rad(self) -> float:
        return 0.0

    def close(self) -> None:
        pass


def mujoco_plant(
    robot: Robot, *, steps_per_tick: int = 1, fine: bool = False, **options: Any
) -> SteppedPlant:
    """A rig's drives on MuJoCo."""
    physical = read_model(robot, **options)
    engine = MujocoWorld(physical, step_s=TICK_S / steps_per_tick, fine=fine)
    return SteppedPlant(physical, engine, steps_per_tick=steps_per_tick, substeps=10)


def drive_about(plant: SteppedPlant, robot: Robot, seconds: float) -> np.ndarray:
    """Joint angles [rad], shape (samples of 5 ms, joints), while goals jump every 0.4 s."""
    rng = np.random.default_rng(3)
    start = {s.servo_id: plant.sample(s.servo_id).position_rad for s in robot.servos}
    rows = []
    for step in range(round(seconds / 0.005)):
        if step % 80 == 0:
            for servo in robot.servos:
                goal = start[servo.servo_id] + float(rng.uniform(-0.5, 0.5))
                law = DriveCommand(torque_enable=True, goal_position_rad=goal, **LAW)
                plant.command(servo.servo_id, law)
        plant.advance(0.005 * (step + 1))
        rows.append([plant.sample(s.servo_id).position_rad for s in robot.servos])
    return np.array(rows)


def run(plant: SteppedPlant, robot: Robot, seconds: float) -> np.ndarray:
    """:func:`drive_about`, and close the plant."""
    try:
        return drive_about(plant, robot, seconds)
    finally:
        plant.close()


def draw(path: Path) -> None:
    """Angles of one leg by both engines, and what is between them."""
    import matplotlib as mpl  # noqa: PLC0415 - only to draw

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    robot, seconds = load_robot("marvin-leg"), 2.4
    bullet = run(BulletPlant(robot), robot, seconds)
    same = run(mujoco_plant(robot), robot, seconds)
    fine = run(mujoco_plant(robot, steps_per_tick=8, fine=True), robot, seconds)
    t_s = 0.005 * (1 + np.arange(len(bullet)))
    figure, (top, middle, bottom) = plt.subplots(
        3, 1, sharex=True, figsize=(7.2, 6.0), layout="tight"
    )
    for i, joint in enumerate(("coxa", "femur", "tibia")):
        (line,) = top.plot(t_s, bullet[:, i], label=joint)
        top.plot(t_s, same[:, i], "--", color="black", linewidth=0.7)
        middle.plot(t_s, 1e15 * (bullet[:, i] - same[:, i]), color=line.get_color())
        bottom.plot(t_s, 1e3 * (bullet[:, i] - fine[:, i]), color=line.get_color())
    top.set_title(
        "One leg of Marvin on a stand: PyBullet (colour) and MuJoCo (dashes)", fontsize=10
    )
    top.set_ylabel("servo angle [rad]")
    top.set_ylim(-2.3, 1.3)
    top.legend(ncols=3, frameon=False, loc="upper left")
    middle.set_ylabel("difference\n[1e-15 rad]")
    middle.set_title("to MuJoCo with the same integrator and the same step, 1 ms", fontsize=9)
    bottom.set_ylabel("difference\n[mrad]")
    bottom.set_title(
        "to MuJoCo with Runge-Kutta at 0.125 ms (one count of the sensor is 5.1 mrad)", fontsize=9
    )
    bottom.set_xlabel("time [s]")
    for axes in (top, middle, bottom):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
