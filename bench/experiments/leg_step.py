"""Leg step: how a joint answers a sudden goal (thesis, figures 31 and 35).

The body is on a stand. Coxa, femur and tibia of one leg get a step in turn, out and back, while
the others stay; the position is read back as fast as the bus allows, that of the stepping joint
alone. Steps are found in the recording by the goals, so any recording of steps can be evaluated.

The thesis prints neither posture nor size of its steps; those below are assumed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from busemu.tables import Robot
from hal.legs import PARTS
from hal.robot_control import RobotControl

from ..recording import Recording, joint_track
from ..running import Session
from .experiment import Choice, ExperimentError, Progress, Trial
from .leg_step_result import LegStep, Step
from .motion import Motion, moving, observe
from .rigs import is_rig, no_such_leg, steps_rad
from .series import Floats, condition, observed, robot_of
from .steps import answer

#: Where the leg is before its steps [rad]: in the air, clear of its neighbours. Assumed.
POSTURE = {"coxa": -0.2, "femur": 0.7, "tibia": -1.2}
STEP_RAD = 0.4
POSE_S = 1.2
#: Time a step is watched for [s]: some ten times what either servo needs for it. Assumed.
WATCH_S = 0.8
#: A goal that jumps by more than this is a step [rad]; assumed: 3 degrees.
JUMP_RAD = math.radians(3.0)
#: Steps begin up to this long after the one before has been watched [s], drawn by the seed, so
#: that repeats fall differently between the ticks of servo and bus.
JITTER_S = 0.02
OBSERVE_S = 0.002


class LegStepExperiment:
    """Runs, evaluates and draws the leg step."""

    name = "leg-step"
    title = "Leg step"
    figures = "31, 35"
    description = (
        "On a stand, coxa, femur and tibia of a leg get a step in turn, read back as fast as the "
        "bus allows: rise, overshoot, settling, steady error."
    )

    def trials(self, robot: Robot, choice: Choice) -> tuple[Trial, ...]:
        """One trial a repeat, with the steps of all three joints, or all of a rig; trunk held."""
        condition: dict[str, Any] = {"leg": choice.leg}
        if is_rig(robot):
            condition = {"joints": list(steps_rad(robot, STEP_RAD))}
        elif any(f"{choice.leg}.{part}" not in robot.by_joint for part in PARTS):
            raise no_such_leg(robot, choice.leg)
        joints = len(condition.get("joints", PARTS))
        return tuple(
            Trial(
                name=f"{self.name}-{repeat:02}",
                repeat=repeat,
                seed=choice.seed + repeat,
                seconds=POSE_S + 2.0 * joints * (WATCH_S + JITTER_S),
                held=True,
                condition=condition,
            )
            for repeat in range(1, choice.repeats + 1)
        )

    def preparation(self, robot: Robot, trial: Trial) -> str:
        """What a person must do with a real robot."""
        if is_rig(robot):
            return (
                f"{robot.name} goes to where its file has it at rest; then it will jump by "
                f"{math.degrees(STEP_RAD):.0f} degrees in each of its joints: keep hands and "
                "cables away."
            )
        return (
            "Put the robot on a stand so that no foot touches anything and the trunk cannot move. "
            f"{trial.condition['leg']} will jump by {math.degrees(STEP_RAD):.0f} degrees in each "
            "of its joints: keep hands and cables away."
        )

    def run(self, session: Session, trial: Trial, progress: Progress) -> Mapping[str, Any]:
        """Take the posture, then step joint after joint."""
        rng = np.random.default_rng(trial.seed)
        if is_rig(session.robot):
            steps = steps_rad(session.robot, STEP_RAD)
        else:
            leg = str(trial.condition["leg"])
            steps = {f"{leg}.{part}": (q, q + STEP_RAD) for part, q in POSTURE.items()}
        names = {f"rig/{joint}_rad" for joint in steps}
        observe(session, OBSERVE_S, names.__contains__)
        with moving(session, list(steps), progress, ("present_voltage",)) as motion:
            motion.go({joint: start for joint, (start, _) in steps.items()}, POSE_S)
            motion.hold(0.3)
            for joint, (start, goal) in steps.items():
                _step(session, motion, joint, goal, rng)
                _step(session, motion, joint, start, rng)
        return {}

    def evaluate(self, recordings: Sequence[Recording]) -> LegStep:
        """Find the steps of ``leg``, or of ``joints``, as the condition names; measure each."""
        robot = robot_of(recordings, self.name)
        listed = recordings[0].metadata.get("condition", {}).get("joints")
        leg = "" if listed else str(condition(recordings[0], "leg"))
        joints = tuple(map(str, listed)) if listed else tuple(f"{leg}.{part}" for part in PARTS)
        steps: list[Step] = []
        periods: list[Floats] = []
        count_rad = 0.0
        for repeat, recording in enumerate(recordings, start=1):
            for joint in joints:
                servo_id = robot.by_joint[joint].servo_id
                count_rad = recording.register(servo_id, "present_position").si_scale
                found = _steps(recording, robot, joint, repeat, count_rad)
                steps += found
                periods += [np.diff(step.t_s) for step in found]
        if not steps:
            which = leg or ", ".join(joints)
            raise ExperimentError(
                f"{self.name}: no goal of {which} jumps by more than {math.degrees(JUMP_RAD):.0f} "
                "degrees in these recordings"
            )
        return LegStep(
            robot=robot.name,
            leg=leg,
            joints=joints,
            repeats=len(recordings),
            count_rad=count_rad,
            period_s=float(np.median(np.concatenate(periods))),
            steps=tuple(steps),
        )

    def draw(self, result: LegStep) -> Figure:
        """Position over time, a column a joint."""
        from .figures.leg_step import leg_step_figure  # noqa: PLC0415

        return leg_step_figure(result)


def _step(
    session: Session,
    motion: Motion,
    joint: str,
    goal_rad: float,
    rng: np.random.Generator,
) -> None:
    """Wait a little, step, and read the one joint as fast as the bus allows."""
    clock = session.clock
    one = RobotControl(session.robot, session.client, [joint])
    clock.sleep_until(clock.now_s() + JITTER_S * float(rng.uniform()))
    one.read_positions()
    motion.goals_rad[joint] = goal_rad
    one.set_goals([goal_rad])
    until_s = clock.now_s() + WATCH_S
    while clock.now_s() < until_s:
        one.read_positions()
    motion.cycle({})


def _steps(
    recording: Recording, robot: Robot, joint: str, repeat: int, count_rad: float
) -> list[Step]:
    """All steps of a joint: from each jump of its goal to its next goal."""
    track = joint_track(recording, joint, robot)
    found = []
    for i in range(1, len(track.goal_rad)):
        before, goal = float(track.goal_rad[i - 1]), float(track.goal_rad[i])
        began_s = float(track.goal_t_s[i])
        end_s = float(track.goal_t_s[i + 1]) if i + 1 < len(track.goal_rad) else math.inf
        inside = (track.position_t_s >= began_s) & (
            track.position_t_s < min(end_s, began_s + WATCH_S)
        )
        if abs(goal - before) < JUMP_RAD or np.count_nonzero(inside) < 10:
            continue
        times = track.position_t_s[inside]
        latest = track.position_rad[track.position_t_s < began_s]
        start = float(latest[-1]) if len(latest) else before
        position = track.position_rad[inside]
        found.append(
            Step(
                joint,
                repeat,
                before,
                goal,
                times - began_s,
                position,
                observed(recording, f"rig/{joint}_rad", times),
                answer(times - began_s, position, start, goal, 2.0 * count_rad),
            )
        )
    return found
