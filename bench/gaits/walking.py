"""One walk with a candidate gait: the robot's own program over the emulated bus, PyBullet behind.

What may count against a gait is taken from where a real robot would have it: torque from the
position errors read over the bus, as the experiments do it. Falls, self-collisions, distance and
energy come from an observer beside the emulated robot.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from busemu.tables import Robot
from busemu.timing import load_profile
from hal.cpg import Gait, LocomotionController
from hal.legs import Legs
from hal.robot_control import RobotControl
from hal.walk import WalkReport, walk
from sim.watch import Event, What
from sim.world import BulletPlant

from ..experiments.locomotion import START_UP_S, velocity_rad_s
from ..experiments.position_error import TorqueSensor
from ..experiments.series import samples
from ..figures.path import displacement
from ..recording import Recording
from ..running import Session, in_process
from .outcome import Job, Outcome

Floats = NDArray[np.float64]

OBSERVE_S = 0.01
#: A robot that rests on more than its feet for longer than this share of a walk has not stood up.
ON_BELLY = 0.5
#: A walk that can be measured has a whole step after its start-up: so many periods at least.
LEAST_PERIODS = 2.0

#: Asked once a control cycle; raises to end the walk.
Check = Callable[[], None]


class _FellError(Exception):
    """Ends a walk early: the robot lies on the ground."""


class Walker:
    """Walks one robot with candidate gaits, each time from the ground up."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.profile = load_profile(robot.timing)
        self.sensors = torque_sensors(robot)

    def __call__(self, job: Job, check: Check = lambda: None) -> Outcome:
        """Walk, and measure. What ``check`` raises ends it, with the torque off."""
        robot = job.candidate.on(self.robot)
        plant = BulletPlant(robot)
        try:
            session = in_process(robot, plant, self.profile)
            eye = _Eye(plant, {joint: s.stall_nm for joint, s in self.sensors.items()})
            return self._walk(job, session, eye, check)
        finally:
            plant.close()

    def _walk(self, job: Job, session: Session, eye: _Eye, check: Check) -> Outcome:
        assert session.bus is not None
        session.bus.every(OBSERVE_S, eye.look)
        controller = LocomotionController.of(session.robot, job.seed)
        control = RobotControl(session.robot, session.client, controller.joints)
        report = WalkReport()
        began_s = math.nan

        def progress(walked_s: float) -> None:
            nonlocal began_s
            began_s = session.clock.now_s() - walked_s
            check()
            if eye.fell_s is not None:
                raise _FellError

        with contextlib.suppress(_FellError):
            report = walk(
                control,
                controller,
                session.clock,
                job.seconds,
                v_left=job.candidate.v_left,
                v_right=job.candidate.v_right,
                progress=progress,
            )
        span = (began_s, session.clock.now_s() if not report.cycles else began_s + report.walked_s)
        return self._measured(job, session, eye, report, span)

    def _measured(
        self,
        job: Job,
        session: Session,
        eye: _Eye,
        report: WalkReport,
        span: tuple[float, float],
    ) -> Outcome:
        seen = eye.seen()
        inside = (seen.t_s >= span[0]) & (seen.t_s <= span[1])
        fell_s = eye.fell_s
        if fell_s is None and np.mean(seen.belly_n[inside] > 0.0) > ON_BELLY:
            fell_s = span[0]  # it never stood up
        steady = seen.t_s[(seen.t_s >= steady_from_s(job, span)) & (seen.t_s <= span[1])]
        whole = displacement(*(column[inside] for column in seen.path))
        speed = 0.0
        if fell_s is None:
            path = [np.interp(steady, seen.t_s, column) for column in seen.path[1:]]
            speed = displacement(steady, *path).speed_m_s
        walked = session.recording("walk", "gait-search")
        largest = largest_torques(self.robot, self.sensors, walked, span)
        name, torque = max(largest.items(), key=itemgetter(1))
        touches = [e for e in eye.events if e.what is What.SELF_CONTACT and e.t_s >= span[0]]
        return Outcome(
            job=job,
            speed_m_s=speed,
            distance_m=whole.distance_m,
            turned_rad=whole.turned_rad,
            energy_j=float(np.sum(seen.power_w[inside]) * OBSERVE_S),
            torque_of_stall=torque,
            torque_joint=name,
            true_torque_of_stall=float(np.max(seen.torque_of_stall[inside])),
            self_collision_share=float(np.mean(seen.self_contact_n[inside] > 0.0)),
            self_collisions=len(touches),
            fell_after_s=math.nan if fell_s is None else max(0.0, fell_s - span[0]),
            clipped_goals=report.clipped_goals,
            missed_deadlines=report.missed_deadlines,
        )


def torque_sensors(robot: Robot) -> dict[str, TorqueSensor]:
    """The position error of every joint as a sensor of its torque."""
    return {mount.joint: TorqueSensor.of(robot, mount, mount.registers) for mount in robot.servos}


def largest_torques(
    robot: Robot,
    sensors: Mapping[str, TorqueSensor],
    recording: Recording,
    span: tuple[float, float],
) -> dict[str, float]:
    """The largest torque of every joint over a span [s], as a share of its stall torque."""
    largest = {}
    for joint, sensor in sensors.items():
        read = samples(recording, robot, joint, span)
        velocity = velocity_rad_s(read.t_s, read.position_rad)
        torque_nm = sensor.torque_nm(read.error_rad, read.voltage_v, velocity)
        largest[joint] = float(np.nanmax(np.abs(torque_nm))) / sensor.stall_nm
    return largest


def steady_from_s(job: Job, span: tuple[float, float]) -> float:
    """When the measured part of a walk begins [s]: after the start-up, whole steps from the end.

    A tripod gait takes two steps a period.
    """
    step_s = 0.5 * job.candidate.period_s
    after_s = span[1] - max(span[0] + START_UP_S, 0.5 * (span[0] + span[1]))
    return span[1] - max(1.0, math.floor(after_s / step_s)) * step_s


def shortest_s(robot: Robot) -> float:
    """The shortest walk that can be measured [s]; ``RobotError`` for a robot that cannot walk."""
    Legs.of(robot)
    return LEAST_PERIODS * Gait.of(robot).period_s


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What an observer saw; all of shape (looks,)."""

    t_s: Floats
    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    self_contact_n: Floats
    belly_n: Floats  #: from the ground on all but the tibiae and feet
    torque_of_stall: Floats  #: the largest of all joints
    power_w: Floats

    @property
    def path(self) -> tuple[Floats, Floats, Floats, Floats]:
        return self.t_s, self.x_m, self.y_m, self.yaw_rad


@dataclass(slots=True)
class _Eye:
    """Looks at an emulated robot every now and then."""

    plant: BulletPlant
    stalls_nm: Mapping[str, float]
    fell_s: float | None = None
    _rows: list[tuple[float, ...]] = field(default_factory=list)
    _events_read: int = 0

    def look(self, now_s: float) -> None:
        """Note where the body is, what touches, what the joints bear, and what the servos take."""
        seen = self.plant.observe()
        torque = max(abs(seen[f"rig/{joint}_nm"]) / nm for joint, nm in self.stalls_nm.items())
        power_w = 0.0
        for joint in self.plant.robot.joints:
            servo = self.plant.sample(joint.servo_id)
            power_w += servo.duty * servo.voltage_v * servo.current_a
        self._rows.append(
            (
                now_s,
                seen["mocap/base_x_m"],
                seen["mocap/base_y_m"],
                seen["mocap/base_yaw_rad"],
                seen["contact/self_n"],
                seen["contact/trunk_n"],
                torque,
                max(0.0, power_w),  # what braking servos give is taken by the others only
            )
        )
        for event in self.events[self._events_read :]:
            if event.what is What.FALL and self.fell_s is None:
                self.fell_s = event.t_s
        self._events_read = len(self.events)

    @property
    def events(self) -> tuple[Event, ...]:
        """What was noticed so far."""
        return tuple(self.plant.events)

    def seen(self) -> _Seen:
        """All looks."""
        return _Seen(*np.array(self._rows).T)
