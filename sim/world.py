"""PyBullet: a robot on flat ground. The only module that imports the engine.

PyBullet knows no inertia of a joint itself, but a servo's rotor, seen through its gear, is heavier
than the links it moves. So the rotors are integrated by the drives (:mod:`sim.drive`), and PyBullet
gets the torque of each gear, with its own joint motors switched off.
"""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot

from .drive.fields import Array
from .entries import PhysicsError
from .model import additions, read_model
from .observer import Camera, Frame, forces_seen, lean_rad, pose_seen
from .quiet import quiet_stderr
from .scene import Push, Scene, Slab, read_scene
from .stability import bearable
from .stepped import STEPS_PER_TICK, SUBSTEPS, TICK_S, SteppedPlant
from .tree import Ground, PhysicalRobot
from .urdf import urdf
from .watch import Contacts

with quiet_stderr():  # it announces its build time
    import pybullet

Pixels = NDArray[np.uint8]

LEVEL = (0.0, 0.0, 0.0, 1.0)
LIGHT = (0.6, -0.5, 1.6)  #: where the light of pictures comes from
FLOOR_M = 0.6  #: half the side of the ground that pictures show
FLOOR_DEPTH_M = 0.005
START_M = 0.4  #: slabs that come so close to the origin lift the robot that starts there; assumed
HELD_HEIGHT_M = 0.5  #: of a trunk held in the air, so that no leg can reach the ground


class World:
    """One robot on flat ground in a PyBullet of its own; joints in the order of its servos.

    ``held`` fixes the trunk in the air, as on a stand. Lengths in m, angles in rad, world z up.
    """

    def __init__(
        self,
        robot: PhysicalRobot,
        *,
        step_s: float,
        held: bool = False,
        slabs: Sequence[Slab] = (),
        pushes: Sequence[Push] = (),
    ) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        if self._client < 0:
            raise RuntimeError("PyBullet gives no more worlds: close some plants first")
        self._on = {"physicsClientId": self._client}
        try:
            self._build(robot, step_s, held)
            for slab in slabs:
                self._lay_slab(slab)
            self._pushes = [(push, self._link[push.body]) for push in pushes]
            self._steps = 0
            lift = max((s.height_m for s in slabs if s.near(START_M) and not held), default=0.0)
            self._start(robot, held, lift)
        except BaseException:
            self.close()
            raise

    def _build(self, robot: PhysicalRobot, step_s: float, held: bool) -> None:
        fixed = held or robot.trunk is None
        pybullet.setGravity(*robot.ground.gravity_m_s2, **self._on)
        pybullet.setPhysicsEngineParameter(
            numSubSteps=0, deterministicOverlappingPairs=1, **self._on
        )
        self.set_step(step_s)
        if robot.trunk is not None:
            self._lay_ground(robot.ground)
        with tempfile.TemporaryDirectory(prefix="busemu-") as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(urdf(robot), "utf-8")
            self._body = pybullet.loadURDF(
                str(path),
                useFixedBase=fixed,
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE
                | pybullet.URDF_USE_SELF_COLLISION
                | pybullet.URDF_USE_SELF_COLLISION_EXCLUDE_PARENT
                | pybullet.URDF_USE_MATERIAL_COLORS_FROM_MTL,
                **self._on,
            )
        joints = range(pybullet.getNumJoints(self._body, **self._on))
        names = [pybullet.getJointInfo(self._body, i, **self._on)[1].decode() for i in joints]
        root = "base" if robot.trunk is None else "trunk"
        self._link = {root: -1, **{name: i for i, name in enumerate(names)}}
        self._name = {link: name for name, link in self._link.items()}
        self._joints = [self._link[joint.name] for joint in robot.joints]
        self._feet = {f"{leg.name}.tibia": leg.name for leg in robot.legs}
        self._rub(robot)
        pybullet.setJointMotorControlArray(
            self._body,
            self._joints,
            pybullet.VELOCITY_CONTROL,
            forces=[0.0] * len(self._joints),
            **self._on,
        )
        local = pybullet.getDynamicsInfo(self._body, -1, **self._on)
        self._to_frame = pybullet.invertTransform(local[3], local[4])
        self._tip_m = {leg.name: (leg.lengths_m["tibia"], 0.0, 0.0) for leg in robot.legs}
        self._from_frame = (local[3], local[4])
        self._free = robot.trunk is not None
        self._order = {joint.name: i for i, joint in enumerate(robot.joints)}

    def _start(self, robot: PhysicalRobot, held: bool, lift_m: float) -> None:
        rest = robot.posture(robot.rest_rad)
        lying = robot.trunk is not None and not held
        height = robot.height_m(robot.rest_rad) if lying else HELD_HEIGHT_M
        self.place((0.0, 0.0, height + lift_m), LEVEL, rest)

    def _rub(self, robot: PhysicalRobot) -> None:
        """Give every link its friction, and the feet their springs."""
        feet = {self._link[f"{leg.name}.tibia"]: leg.foot for leg in robot.legs}
        for link in self._link.values():
            friction = feet[link].friction if link in feet else robot.contact.friction
            pybullet.changeDynamics(
                self._body,
                link,
                lateralFriction=friction,
                restitution=robot.contact.restitution,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                **self._on,
            )
        for link, foot in feet.items():
            self._soften(self._body, link, foot.stiffness_n_m, foot.damping_n_s_m)

    def _soften(self, body: int, link: int, stiffness_n_m: float, damping_n_s_m: float) -> None:
        """Give a link's contacts a spring and a damper; a rigid one is left as it is."""
        if math.isfinite(stiffness_n_m):
            pybullet.changeDynamics(
                body,
                link,
                contactStiffness=stiffness_n_m,
                contactDamping=damping_n_s_m,
                **self._on,
            )

    def set_step(self, step_s: float) -> None:
        """Make every further step so long."""
        self.step_s = step_s
        pybullet.setPhysicsEngineParameter(fixedTimeStep=step_s, **self._on)

    def _lay_ground(self, ground: Ground) -> None:
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **self._on)
        floor = pybullet.createVisualShape(
            pybullet.GEOM_BOX,
            halfExtents=[FLOOR_M, FLOOR_M, FLOOR_DEPTH_M],
            visualFramePosition=[0.0, 0.0, -FLOOR_DEPTH_M],
            rgbaColor=[1.0, 1.0, 1.0, 1.0],
            **self._on,
        )
        self._ground = pybullet.createMultiBody(0.0, plane, floor, **self._on)
        self._surface(self._ground, ground)

    def _lay_slab(self, slab: Slab) -> None:
        half = [0.5 * slab.size_m[0], 0.5 * slab.size_m[1], 0.5 * slab.height_m]
        box = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **self._on)
        body = pybullet.createMultiBody(
            0.0,
            box,
            basePosition=[*slab.at_m, half[2]],
            baseOrientation=pybullet.getQuaternionFromEuler([0.0, 0.0, slab.yaw_rad]),
            **self._on,
        )
        self._surface(body, slab.surface)

    def _surface(self, body: int, ground: Ground) -> None:
        pybullet.changeDynamics(
            body, -1, lateralFriction=ground.friction, restitution=1.0, **self._on
        )
        self._soften(body, -1, ground.stiffness_n_m, ground.damping_n_s_m)

    def place(
        self,
        position_m: tuple[float, float, float],
        orientation_xyzw: tuple[float, float, float, float],
        joints_rad: Mapping[str, float],
    ) -> None:
        """Put the trunk frame and the joints somewhere, at rest."""
        where = pybullet.multiplyTransforms(position_m, orientation_xyzw, *self._from_frame)
        pybullet.resetBasePositionAndOrientation(self._body, *where, **self._on)
        pybullet.resetBaseVelocity(self._body, [0.0] * 3, [0.0] * 3, **self._on)
        for name, angle in joints_rad.items():
            joint = self._joints[self._order[name]]
            pybullet.resetJointState(self._body, joint, angle, 0.0, **self._on)

    def read(self, position_rad: Array, velocity_rad_s: Array) -> None:
        """Write the joints' angles [rad] and velocities [rad/s] into the two arrays."""
        states = pybullet.getJointStates(self._body, self._joints, **self._on)
        position_rad[:] = [state[0] for state in states]
        velocity_rad_s[:] = [state[1] for state in states]

    def step(self, torque_nm: Array) -> None:
        """Apply joint torques [N m] over one step."""
        pybullet.setJointMotorControlArray(
            self._body, self._joints, pybullet.TORQUE_CONTROL, forces=torque_nm.tolist(), **self._on
        )
        if self._pushes:
            self._push()
        self._steps += 1
        self.step_bare()

    def _push(self) -> None:
        """Apply what pushes during the step to come."""
        now_s = (self._steps + 0.5) * self.step_s
        for push, link in self._pushes:
            if push.at_s <= now_s < push.at_s + push.for_s:
                frame = self.base() if link < 0 else self._frame(link)
                place = pybullet.multiplyTransforms(*frame, push.at_m, LEVEL)[0]
                pybullet.applyExternalForce(
                    self._body, link, push.force_n, place, pybullet.WORLD_FRAME, **self._on
                )

    def _frame(self, link: int) -> Frame:
        """Position [m] and orientation (x, y, z, w) of a link's own frame in the world."""
        state = pybullet.getLinkState(self._body, link, computeForwardKinematics=True, **self._on)
        return state[4], state[5]

    def step_bare(self) -> None:
        """One step of the engine and nothing else: the floor of what a step can cost."""
        pybullet.stepSimulation(**self._on)

    def base(self) -> Frame:
        """Position [m] and orientation (x, y, z, w) of the trunk frame in the world."""
        centre = pybullet.getBasePositionAndOrientation(self._body, **self._on)
        position, orientation = pybullet.multiplyTransforms(*centre, *self._to_frame)
        return position, orientation

    def feet(self) -> dict[str, tuple[float, float, float]]:
        """Centre of every foot in the world [m], by leg."""
        where = {}
        for body, leg in self._feet.items():
            frame = self._frame(self._link[body])
            where[leg] = pybullet.multiplyTransforms(*frame, self._tip_m[leg], LEVEL)[0]
        return where

    def contacts(self) -> Contacts:
        """Normal forces [N] from the ground by body, and within the robot by pair of bodies."""
        ground: dict[str, float] = {}
        own: dict[tuple[str, str], float] = {}
        for point in pybullet.getContactPoints(self._body, **self._on):
            force = point[9]
            if force <= 0.0:
                continue
            body = self._name[point[3]]
            if point[2] == self._body:
                other = self._name[point[4]]
                pair = (body, other) if body < other else (other, body)
                own[pair] = own.get(pair, 0.0) + force
            else:
                ground[body] = ground.get(body, 0.0) + force
        return Contacts(ground, own)

    def lean_rad(self) -> float:
        """Angle between the trunk's z axis and the ground's normal [rad]."""
        return lean_rad(self.base()[1])

    def observe(self) -> dict[str, float]:
        """Pose of the trunk frame and normal forces: see :mod:`sim.observer`."""
        seen: dict[str, float] = {}
        if self._free:
            position, orientation = self.base()
            seen = pose_seen(position, pybullet.getMatrixFromQuaternion(orientation))
        return seen | forces_seen(self.contacts(), self._feet, trunk=self._free)

    def photograph(self, camera: Camera) -> tuple[Pixels, NDArray[np.bool_]]:
        """What a camera sees: (height, width, 3) colours, and (height, width) where robot is.

        The ground around the origin is plain white, with the robot's shadow; beyond it is nothing.
        """
        width, height, pixels, _, body = pybullet.getCameraImage(
            camera.width_px,
            camera.height_px,
            pybullet.computeViewMatrix(camera.eye_m, camera.target_m, [0.0, 0.0, 1.0]),
            pybullet.computeProjectionMatrixFOV(
                camera.field_deg, camera.width_px / camera.height_px, 0.02, 10.0
            ),
            lightDirection=LIGHT,
            lightColor=[1.0, 1.0, 1.0],
            lightDistance=1.0,
            lightAmbientCoeff=0.55,
            lightDiffuseCoeff=0.45,
            lightSpecularCoeff=0.05,
            shadow=1,
            renderer=pybullet.ER_TINY_RENDERER,
            **self._on,
        )
        colours = np.asarray(pixels, np.uint8).reshape(height, width, 4)[:, :, :3]
        return colours, np.asarray(body).reshape(height, width) == self._body

    def inverse_mass(self) -> Array:
        """The joints' part of the inverse mass matrix [1/(kg m^2)] at the present posture."""
        count = pybullet.getNumJoints(self._body, **self._on)
        angles = [s[0] for s in pybullet.getJointStates(self._body, range(count), **self._on)]
        mass = np.array(pybullet.calculateMassMatrix(self._body, angles, **self._on))
        offset = mass.shape[0] - count
        rows = [offset + joint for joint in self._joints]
        return np.linalg.inv(mass)[np.ix_(rows, rows)]

    def close(self) -> None:
        """Disconnect; may be called twice."""
        if self._client >= 0:
            with contextlib.suppress(pybullet.error):
                pybullet.disconnect(**self._on)
            self._client = -1


class BulletPlant(SteppedPlant):
    """A robot in PyBullet behind its servos; satisfies :class:`busemu.plant.Plant`.

    Steps of 1 ms: against steps of 0.125 ms, joints of a held robot that steps its goals differ by
    at most 2 mrad and 0.4 mrad RMS (a count of the sensor is 5 mrad); on the ground the instants of
    contacts differ more, and no less with shorter steps.

    A hexapod starts lying on its belly in the posture ``[rest]`` of its file, torque off. ``held``
    fixes the trunk in the air, ``trunk_load_kg`` is added to the trunk. A rig's base is always
    fixed. Where light links on a stiff gear ask for it, the steps of a rig, or of a hexapod with
    effects, are shorter; a hexapod whose own file does so is refused. ``condition`` are words of a
    recording (:func:`sim.condition.under`), ``scene`` is what is around the robot, ``clamps`` block
    joints between two angles. Falls, self-contacts and links on the ground are in ``events``.
    Raises :class:`sim.entries.PhysicsError` when the file's physics cannot be used or is too stiff.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        held: bool = False,
        trunk_load_kg: float = 0.0,
        condition: Mapping[str, Any] | None = None,
        scene: Scene | None = None,
        clamps: Mapping[str, tuple[float, float]] | None = None,
        steps_per_tick: int | None = None,
        substeps: int = SUBSTEPS,
    ) -> None:
        physical = read_model(robot, trunk_load_kg=trunk_load_kg, condition=condition)
        scene = scene or Scene()
        physical = scene.around(physical).clamped(clamps or {})
        self.robot = physical
        self.world = World(
            physical, step_s=TICK_S, held=held, slabs=scene.slabs, pushes=scene.pushes
        )
        try:
            choices = (steps_per_tick,) if steps_per_tick else STEPS_PER_TICK
            if not steps_per_tick and physical.trunk is not None and not additions(robot):
                choices = STEPS_PER_TICK[:1]
            chosen = self._stable(choices, str(robot.path))
            self.world.set_step(TICK_S / chosen)
            super().__init__(physical, self.world, steps_per_tick=chosen, substeps=substeps)
        except BaseException:
            self.world.close()
            raise

    def _stable(self, choices: Sequence[int], where: str) -> int:
        """Steps per tick that the gears bear at rest, neutral, and stretched out, the stiffest."""
        robot, world = self.robot, self.world
        stretched = {j.name: min(j.upper_rad, max(j.lower_rad, 0.0)) for j in robot.joints}
        rest, neutral = robot.posture(robot.rest_rad), robot.posture(robot.neutral_rad)
        position, orientation = world.base()
        masses = []
        for posture in (stretched, neutral, rest):
            world.place(position, orientation, posture)
            try:
                masses.append(world.inverse_mass())
            except np.linalg.LinAlgError:
                raise PhysicsError(
                    f"{where}: what a joint moves has no inertia about its axis (0 kg m^2): give "
                    "its [[body]] inertia_kg_m2, a com_m beside the axis, or a payload"
                ) from None
        drives = {joint.name: joint.drive for joint in robot.joints}
        steps, self.stiffness_number = bearable(drives, masses, TICK_S, choices, where)
        return steps


def plant(robot: Robot, world: Path | None = None) -> BulletPlant:
    """The PyBullet plant of a robot (the plant named ``bullet`` on the command line).

    ``world``: a file of what is around it (:mod:`sim.scene`).
    """
    return BulletPlant(robot, scene=None if world is None else read_scene(world))
