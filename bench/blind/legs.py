"""A legged robot on MuJoCo behind the emulated bus: an own plant, with an own body and ground."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from busemu.plant import DriveCommand, ServoState
from busemu.tables import Robot

from .drives import Drives, Electrics
from .instant import TICK_S
from .legged import STEP_S, Body, document, rest_rad

Floats = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
SUBSTEPS = round(TICK_S / STEP_S)
ROUNDING_S = 1e-9


class LegsPlant:
    """:class:`busemu.plant.Plant` on MuJoCo: hexapod on the ground, or legs of it on a stand."""

    def __init__(
        self, robot: Robot, body: Body | None = None, electrics: Electrics | None = None
    ) -> None:
        body, electrics = body or Body(), electrics or Electrics()
        self._robot, self.body = robot, body
        self.model = model = mujoco.MjModel.from_xml_string(document(robot, body))
        self.data = data = mujoco.MjData(model)
        there = [s for s in robot.servos if not body.legs or s.joint.split(".")[0] in body.legs]
        self._joints = [servo.joint for servo in there]
        self._index = {servo.servo_id: i for i, servo in enumerate(there)}
        # servos of legs that are not there stand where they are
        rest = rest_rad(robot)
        self._absent = {
            s.servo_id: s.to_servo(rest[s.joint]) for s in robot.servos if s not in there
        }
        self._sign = np.array([float(servo.direction) for servo in there])
        zero = [s.zero_rad + (electrics.zero_rad or {}).get(s.joint, 0.0) for s in there]
        self._zero = np.array(zero)
        names = [model.joint(j).name for j in range(model.njnt)]
        self._rotor = np.array([names.index(joint) for joint in self._joints])
        # behind the rotor: the gear's twist and its play, where they are
        self._behind = []
        for kind in ("twist", "play"):
            which = [i for i, j in enumerate(self._joints) if f"{j}/{kind}" in names]
            if which:
                found = [names.index(f"{self._joints[i]}/{kind}") for i in which]
                self._behind.append((np.array(which), np.array(found)))
        self._q, self._v = model.jnt_qposadr, model.jnt_dofadr
        self.drives = Drives(robot, self._joints, electrics)
        model.dof_frictionloss[self._v[self._rotor]] = self.drives.coulomb_nm
        for joint, index in zip(self._joints, self._rotor, strict=True):
            data.qpos[self._q[index]] = rest[joint]
        mujoco.mj_forward(model, data)
        self._ticks, self._now_s = 0, 0.0
        self._feet = {leg["name"]: self._geom(leg["name"]) for leg in robot.document["leg"]}
        self._base = body.support == "ground"
        self._torque: Floats = np.zeros(len(there))
        self._control()

    def _geom(self, name: str) -> int:
        return int(mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, name))

    def _outputs(self) -> tuple[Floats, Floats, Floats]:
        """Servo angles and speeds at the sensors, and the rotors' speeds, in the servos' frames."""
        q, v = self.data.qpos, self.data.qvel
        angle, rotor = q[self._q[self._rotor]], v[self._v[self._rotor]]
        speed = rotor.copy()
        for which, joints in self._behind:
            angle[which] += q[self._q[joints]]
            speed[which] += v[self._v[joints]]
        servo: Floats = self._sign * (angle - self._zero)
        return servo, self._sign * speed, self._sign * rotor

    def _control(self) -> None:
        """The tick at the present instant: what the drives do until the next."""
        self.position_rad, self.velocity_rad_s, rotor = self._outputs()
        self._torque = self.drives.tick(self.position_rad, rotor, self._ticks * TICK_S)
        dofs = self._v[self._rotor]
        self.data.qfrc_applied[dofs] = self._sign * self._torque
        self.model.dof_damping[dofs] = self.drives.damping_nm_s_rad

    def advance(self, to_s: float) -> None:
        """Simulate up to ``to_s`` [s]."""
        if not to_s >= self._now_s:
            raise ValueError(f"a plant cannot go back from {self._now_s} s to {to_s} s")
        while (self._ticks + 1) * TICK_S <= to_s + ROUNDING_S:
            mujoco.mj_step(self.model, self.data, SUBSTEPS)
            self._ticks += 1
            self._control()
        if not math.isfinite(float(self.data.qpos.sum())):
            raise ArithmeticError(f"the engine became unstable at {self._now_s:.3f} s")
        self._now_s = to_s

    @property
    def now_s(self) -> float:
        """The instant last advanced to [s]."""
        return self._now_s

    def command(self, servo_id: int, command: DriveCommand) -> None:
        """Set what a drive shall do from the next control tick on."""
        if servo_id in self._absent:
            return
        self.drives.order(self._index[servo_id], command)

    def sample(self, servo_id: int) -> ServoState:
        """State of one servo at the instant last advanced to."""
        drives = self.drives
        if servo_id in self._absent:
            at = self._absent[servo_id]
            return ServoState(at, 0.0, 0.0, 0.0, 0.0, drives.rail_v, drives.electrics.ambient_c)
        i = self._index[servo_id]
        since_s = self._now_s - self._ticks * TICK_S
        speed = float(self.velocity_rad_s[i])
        current = float(drives.current_a[i])
        return ServoState(
            position_rad=float(self.position_rad[i]) + speed * since_s,
            velocity_rad_s=speed,
            duty=float(drives.duty[i]),
            torque_nm=float(drives.torque_nm_a[i]) * current,
            current_a=current,
            voltage_v=drives.rail_v + (drives.electrics.sense_v or {}).get(self._joints[i], 0.0),
            temperature_c=float(drives.temperature_c[i]),
        )

    @property
    def stands(self) -> NDArray[np.bool_]:
        """For every servo that is there, whether the foot of its leg presses on the ground."""
        found = self.observe()
        legs = [joint.split(".")[0] for joint in self._joints]
        return np.array([found.get(f"contact/{leg}_n", 0.0) > 0.0 for leg in legs])

    def observe(self) -> Mapping[str, float]:
        """Pose of the body and force on the feet [SI]; ``imu/`` is what a sensor on it says."""
        found: dict[str, float] = {}
        if self._base:
            body = self.data.body("trunk")
            x, y, z = (float(c) for c in body.xpos)
            m = body.xmat.reshape(3, 3)
            roll = math.atan2(m[2, 1], m[2, 2])
            pitch = math.asin(max(-1.0, min(1.0, -m[2, 0])))
            yaw = math.atan2(m[1, 0], m[0, 0])
            found = {f"mocap/base_{n}_m": c for n, c in (("x", x), ("y", y), ("z", z))}
            for name, angle in (("roll", roll), ("pitch", pitch), ("yaw", yaw)):
                found[f"mocap/base_{name}_rad"] = angle
            found["imu/roll_rad"], found["imu/pitch_rad"] = roll, pitch
            found |= {f"contact/{leg}_n": 0.0 for leg in self._feet}
            force = np.zeros(6)
            by_geom = {geom: leg for leg, geom in self._feet.items()}
            for c in range(self.data.ncon):
                contact = self.data.contact[c]
                for geom in (int(contact.geom1), int(contact.geom2)):
                    if geom in by_geom:
                        mujoco.mj_contactForce(self.model, self.data, c, force)
                        found[f"contact/{by_geom[geom]}_n"] += float(force[0])
        return found
