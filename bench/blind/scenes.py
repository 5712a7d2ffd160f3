"""Scenes of legged robots on the emulated bus: a leg on a stand, or a whole robot on its feet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import cycle
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from bench.motions import ExperimentPlan, StandPlan, WalkPlan, motion
from bench.running import Session, Steering, in_process, walk_in
from busemu.plant import ServoState
from busemu.tables import Robot, load_robot
from busemu.timing import load_profile
from hal.robot_control import RobotControl

from .drives import Electrics
from .legged import Body
from .legs import LegsPlant
from .standing import stand

Floats = NDArray[np.float64]
Plan = ExperimentPlan | WalkPlan | StandPlan

#: a leg in the air, clear of its neighbours [rad]; assumed
POSTURE = {"coxa": 0.0, "femur": 0.5, "tibia": -1.2}
POSE_S = 1.0
LEG = "leg1"
OBSERVE_S = 0.02
#: of a walk: enough turns of the gait that chance in them averages out
WALK_S = 10.0


@dataclass(frozen=True, slots=True)
class Group:
    """Recordings of one plan."""

    name: str
    plan: Plan
    repeats: int = 2


@dataclass(frozen=True)
class Scene:
    """A robot, how it is held, and what is recorded of it."""

    name: str
    robot_name: str
    support: str
    groups: tuple[Group, ...]
    held_out: tuple[str, ...]
    sized_on: tuple[str, ...]  #: groups that sizes of effects are measured on

    @property
    def robot(self) -> Robot:
        """The robot as its file has it: what the operator believes."""
        return _robot(self.robot_name)

    @property
    def legs(self) -> tuple[str, ...]:
        """Legs that are there; on a stand only one is watched."""
        return (LEG,) if self.support == "suspended" else ()

    @property
    def walks(self) -> bool:
        """Whether the robot walks."""
        return any(isinstance(group.plan, WalkPlan) for group in self.groups)

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints that are recorded."""
        every = tuple(self.robot.by_joint)
        return tuple(j for j in every if not self.legs or j.split(".")[0] in self.legs)


@cache
def _robot(name: str) -> Robot:
    return load_robot(name)


def _on_stand(name: str, what: str, link: str, amplitude_rad: float, seconds: float) -> Group:
    center = POSTURE[link]
    moving = motion(what, amplitude_rad=amplitude_rad, center_rad=center, duration_s=seconds)
    return Group(name, ExperimentPlan(moving, joint=f"{LEG}.{link}"))


_LEG_GROUPS = (
    _on_stand("coxa-steps", "steps", "coxa", 0.5, 4.0),
    _on_stand("femur-steps", "steps", "femur", 0.45, 4.0),
    _on_stand("tibia-steps", "steps", "tibia", 0.6, 4.0),
    _on_stand("femur-dither", "dither", "femur", 0.4, 4.0),
    _on_stand("tibia-dither", "dither", "tibia", 0.6, 4.0),
    _on_stand("femur-sin-sin-held-out", "sin_sin", "femur", 0.45, 5.0),
    _on_stand("tibia-sin-sin-held-out", "sin_sin", "tibia", 0.6, 5.0),
)


def _walks(payload_kg: float) -> tuple[Group, ...]:
    return (
        Group("straight", WalkPlan(WALK_S)),
        Group("turn", WalkPlan(WALK_S, v_left=0.4, v_right=1.4)),
        Group("straight-loaded-held-out", WalkPlan(WALK_S, payload_kg=payload_kg, seed=3)),
    )


def _stands(payload_kg: float) -> tuple[Group, ...]:
    return (
        Group("squat", StandPlan("squat")),
        Group("stretch", StandPlan("stretch")),
        Group("sway-loaded-held-out", StandPlan("sway", payload_kg)),
    )


#: the scenes by name; the weights are those of the thesis's torque experiment
SCENES: Mapping[str, Scene] = MappingProxyType(
    {
        scene.name: scene
        for scene in (
            Scene(
                "marvin-leg",
                "marvin",
                "suspended",
                _LEG_GROUPS,
                ("femur-sin-sin-held-out", "tibia-sin-sin-held-out"),
                ("tibia-steps", "femur-dither"),
            ),
            Scene(
                "marvin-walk",
                "marvin",
                "ground",
                _walks(0.092),
                ("straight-loaded-held-out",),
                ("straight",),
            ),
            Scene(
                "phantomx-walk",
                "phantomx",
                "ground",
                _walks(0.330),
                ("straight-loaded-held-out",),
                ("straight",),
            ),
            Scene(
                "marvin-stand",
                "marvin",
                "ground",
                _stands(0.092),
                ("sway-loaded-held-out",),
                ("squat", "stretch"),
            ),
            Scene(
                "phantomx-stand",
                "phantomx",
                "ground",
                _stands(0.330),
                ("sway-loaded-held-out",),
                ("squat", "stretch"),
            ),
        )
    }
)


class Watched(LegsPlant):
    """A plant that remembers the truth of everything that was sampled."""

    def __init__(self, robot: Robot, body: Body, electrics: Electrics) -> None:
        super().__init__(robot, body, electrics)
        self.seen: dict[int, list[tuple[float, float]]] = {}

    def sample(self, servo_id: int) -> ServoState:
        """See :meth:`LegsPlant.sample`."""
        state = super().sample(servo_id)
        self.seen.setdefault(servo_id, []).append((self.now_s, state.position_rad))
        return state


@dataclass(frozen=True)
class Played:
    """What came of a plan: the session with its recorder, the plant, and true joint positions.

    Every ``OBSERVE_S``, shape (instants, servos that are there): ``track_rad`` are servo angles,
    ``stands`` is whether the foot of the servo's leg presses on the ground.
    """

    session: Session
    plant: Watched
    track_rad: Floats
    stands: NDArray[np.bool_]


def play(
    scene: Scene,
    plan: Plan,
    body: Body,
    electrics: Electrics,
    robot: Robot | None = None,
    *,
    reads: Sequence[str] = (),
) -> Played:
    """Run a plan by the robot's own software over the emulated bus in virtual time.

    ``robot`` is the scene's with another gait, where it shall walk one. ``reads`` are registers
    that are read beside the positions of a robot on its feet: of one servo a cycle, by turns.
    """
    robot = robot or scene.robot
    plant = Watched(robot, body, electrics)
    session = in_process(robot, plant, load_profile(robot.timing), observe_every_s=OBSERVE_S)
    seen: list[tuple[Floats, NDArray[np.bool_]]] = []
    assert session.bus is not None
    session.bus.every(OBSERVE_S, lambda _: seen.append((plant.position_rad.copy(), plant.stands)))
    if isinstance(plan, WalkPlan):
        walk_in(
            session,
            Steering(
                seconds=plan.seconds, v_left=plan.v_left, v_right=plan.v_right, seed=plan.seed
            ),
            _by_turns(session, reads),
        )
    elif isinstance(plan, StandPlan):
        stand(session, plan, _by_turns(session, reads))
    else:
        _move(scene, session, plan)
    track, stands = (np.array(part) for part in zip(*seen, strict=True))
    return Played(session, plant, track, stands)


def _by_turns(session: Session, registers: Sequence[str]) -> Callable[[float], None]:
    """Reads these registers of the next servo whenever a cycle is over."""
    ids = cycle(session.robot.by_id)

    def read(_: float) -> None:
        servo_id = next(ids)
        for register in registers:
            session.client.read(servo_id, register)

    return read


def _move(scene: Scene, session: Session, plan: ExperimentPlan) -> None:
    """One joint moves, the others of its leg stay; positions are read as fast as the bus allows."""
    clock = session.clock
    control = RobotControl(scene.robot, session.client, scene.joints)
    goals = {joint: POSTURE[joint.split(".")[1]] for joint in scene.joints}
    joint = plan.joint or f"{LEG}.tibia"
    goals[joint] = float(plan.motion.goal_rad(0.0))
    start = dict(zip(control.joints, control.read_positions().tolist(), strict=True))
    control.unlimit_speed()
    for register, raw in plan.registers.items():
        session.client.sync_write(register, dict.fromkeys(control.ids, raw))
    control.set_goals(start)
    control.torque_on()
    began_s = clock.now_s()
    off_s = plan.motion.torque_off_s
    off = False
    while (t_s := clock.now_s() - began_s - POSE_S) < plan.motion.duration_s:
        way = min(max(1.0 + t_s / POSE_S, 0.0), 1.0)
        sent = {j: start[j] + (goals[j] - start[j]) * way for j in goals}
        if t_s >= 0.0:
            sent = {joint: float(plan.motion.goal_rad(t_s))}
        if off_s is not None and t_s >= off_s:
            if not off:
                control.torque_off()
            off = True
        else:
            control.set_goals(sent)
        control.read_positions()
    control.torque_off()
