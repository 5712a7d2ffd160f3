"""Locomotion: a tripod walk from random start states (thesis, figures 32, 36 and 37).

The robot's own pattern-generator walk, ten seconds a repeat, each from another random state.
Joints are looked at over the phase of the gait: how they follow, what torque their position error
stands for against the limit of 0.75 x stall, and how far they are off on average while their leg
carries the robot, which is what the thesis could not explain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from busemu.tables import Robot
from hal.cpg import LocomotionController
from hal.legs import PARTS, Legs, UnreachableError

from ..figures.path import Displacement, displacement
from ..recording import Recording, joint_track
from ..running import Session, Steering, walk_in
from .experiment import Choice, ExperimentError, Progress, Trial
from .gait_phase import Cycles, cycles, feet_m
from .locomotion_result import JointCourse, LegCourse, Locomotion, Walk
from .motion import observe, read_law
from .position_error import TorqueSensor
from .rigs import only_hexapods
from .series import Floats, observed, robot_of, samples, span_s

#: Standing up takes this long (see :mod:`hal.walk`) [s].
STAND_UP_S = 1.5
#: The start-up, left out of all averages [s]: the rhythm locks within two or three periods.
START_UP_S = 3.0
#: After the start-up a whole step is within so many periods, wherever they begin.
STEPS_SEEN = 2.0
OBSERVE_S = 0.01
#: Velocities are differences over this many samples to either side.
REACH = 2


class LocomotionExperiment:
    """Runs, evaluates and draws the walk."""

    name = "locomotion"
    title = "Locomotion"
    figures = "32, 36, 37"
    description = (
        "The pattern-generator tripod walk from random start states: joints and torques over the "
        "gait's phase, torque limit, self-collision, stride, stance error."
    )

    def trials(self, robot: Robot, choice: Choice) -> tuple[Trial, ...]:
        """One trial a repeat, each from another start state."""
        only_hexapods(robot, self.name)
        controller = LocomotionController.of(robot)
        try:
            controller.check(choice.v_left, choice.v_right)
        except UnreachableError as error:
            raise ExperimentError(str(error)) from None
        period_s = controller.gait.period_s
        least_s = min(2.0 * STEPS_SEEN * period_s, START_UP_S + STEPS_SEEN * period_s)
        if choice.seconds < least_s:
            raise ExperimentError(
                f"--seconds must be at least {least_s:g} s, so that every leg makes a whole step "
                f"after the start-up, not {choice.seconds:g}"
            )
        return tuple(
            Trial(
                name=f"{self.name}-{repeat:02}",
                repeat=repeat,
                seed=choice.seed + repeat,
                seconds=STAND_UP_S + choice.seconds,
                condition={
                    "seconds": choice.seconds,
                    "v_left": choice.v_left,
                    "v_right": choice.v_right,
                },
            )
            for repeat in range(1, choice.repeats + 1)
        )

    def preparation(self, robot: Robot, trial: Trial) -> str:
        """What a person must do with a real robot."""
        return (
            "Put the robot on its belly on a level floor with two metres free before it and one "
            f"on either side. It will stand up and walk for {trial.condition['seconds']:g} s."
        )

    def run(self, session: Session, trial: Trial, progress: Progress) -> Mapping[str, object]:
        """Stand up and walk."""
        wanted = trial.condition
        steering = Steering(
            float(wanted["seconds"]),
            float(wanted["v_left"]),
            float(wanted["v_right"]),
            seed=trial.seed,
        )
        read_law(session, tuple(session.robot.by_joint))
        observe(session, OBSERVE_S, lambda name: not name.endswith("_rad") or "base" in name)
        report, finished = walk_in(
            session, steering, lambda walked_s: progress(STAND_UP_S + walked_s)
        )
        if not finished:
            raise KeyboardInterrupt
        goals = session.recording(trial.name, self.name)
        last_s = max(
            float(goals.series(servo_id, "goal_position", "write").t_sample_s[-1])
            for servo_id in session.robot.by_id
        )
        return {
            "walking_s": [last_s - report.walked_s, last_s],
            "missed_deadlines": report.missed_deadlines,
            "clipped_goals": report.clipped_goals,
        }

    def evaluate(self, recordings: Sequence[Recording]) -> Locomotion:
        """Look at the steady part of every walk over the phase of its gait."""
        robot = robot_of(recordings, self.name)
        legs = Legs.of(robot)
        sensors = {
            mount.joint: TorqueSensor.of_recording(recordings[0], robot, mount.joint)
            for mount in robot.servos
        }
        return Locomotion(
            robot=robot.name,
            stalls_nm={joint: sensor.stall_nm for joint, sensor in sensors.items()},
            count_rad=next(iter(sensors.values())).count_rad,
            legs=legs.names,
            walks=tuple(
                _walk(recording, robot, legs, sensors, repeat)
                for repeat, recording in enumerate(recordings, start=1)
            ),
        )

    def draw(self, result: Locomotion) -> Figure:
        """A column a leg: foot path, joint angles, torques."""
        from .figures.locomotion import locomotion_figure  # noqa: PLC0415

        return locomotion_figure(result)


def _walk(
    recording: Recording,
    robot: Robot,
    legs: Legs,
    sensors: Mapping[str, TorqueSensor],
    repeat: int,
) -> Walk:
    span = span_s(recording, "walking_s")
    steady = (min(span[0] + START_UP_S, 0.5 * (span[0] + span[1])), span[1])
    tracks = {joint: joint_track(recording, joint, robot) for joint in sensors}
    first = tracks[legs.joints[0]]
    goal_t_s = first.goal_t_s[(first.goal_t_s >= steady[0]) & (first.goal_t_s <= steady[1])]
    commanded = feet_m(legs, {joint: track.goal_at(goal_t_s) for joint, track in tracks.items()})
    read = {
        joint: np.interp(goal_t_s, track.position_t_s, track.position_rad)
        for joint, track in tracks.items()
    }
    measured = feet_m(legs, read)
    by_leg = []
    for number, leg in enumerate(legs.names):
        gait = cycles(goal_t_s, commanded[:, number, 2])
        if not len(gait.end_s):
            raise ExperimentError(
                f"{recording.name}: {leg} makes no whole step in {steady[1] - steady[0]:.1f} s: "
                "record a longer walk"
            )
        phase, stance = gait.phase(goal_t_s)
        by_leg.append(
            LegCourse(
                leg,
                gait.period_s,
                gait.duty_factor,
                phase,
                stance,
                commanded[:, number],
                measured[:, number],
                tuple(
                    _joint(recording, robot, sensors[f"{leg}.{part}"], gait, steady)
                    for part in PARTS
                ),
            )
        )
    return Walk(
        repeat=repeat,
        seconds=span[1] - span[0],
        legs=tuple(by_leg),
        moved=_moved(recording, steady),
        self_contact_n=_self_contact(recording, span),
    )


def _joint(
    recording: Recording,
    robot: Robot,
    sensor: TorqueSensor,
    gait: Cycles,
    steady: tuple[float, float],
) -> JointCourse:
    found = samples(recording, robot, sensor.joint, steady)
    phase, stance = gait.phase(found.t_s)
    return JointCourse(
        joint=sensor.joint,
        phase=phase,
        stance=stance,
        goal_rad=found.position_rad + found.error_rad,
        position_rad=found.position_rad,
        torque_nm=sensor.torque_nm(
            found.error_rad, found.voltage_v, velocity_rad_s(found.t_s, found.position_rad)
        ),
        static_nm=sensor.torque_nm(found.error_rad, found.voltage_v),
        true_nm=found.true_nm,
    )


def velocity_rad_s(t_s: Floats, position_rad: Floats) -> Floats:
    """Velocity [rad/s] from positions a few samples apart; shape (samples,)."""
    index = np.arange(len(t_s))
    before, after = np.maximum(index - REACH, 0), np.minimum(index + REACH, len(t_s) - 1)
    apart = t_s[after] - t_s[before]
    way = position_rad[after] - position_rad[before]
    return np.where(apart > 0.0, way / np.where(apart > 0.0, apart, 1.0), 0.0)


def _moved(recording: Recording, steady: tuple[float, float]) -> Displacement | None:
    """How far the body went in the steady part, where someone watched it."""
    times = recording.observed("mocap/base_x_m").t_sample_s
    inside = (times >= steady[0]) & (times <= steady[1])
    if not inside.any():
        return None
    pose = [
        observed(recording, f"mocap/base_{k}", times[inside]) for k in ("x_m", "y_m", "yaw_rad")
    ]
    return displacement(times[inside], *pose)


def _self_contact(recording: Recording, span: tuple[float, float]) -> Floats | None:
    """Force between the robot's own links over the walk [N], where it was watched."""
    force = recording.observed("contact/self_n")
    inside = (force.t_sample_s >= span[0]) & (force.t_sample_s <= span[1])
    return force.value[inside] if inside.any() else None
