"""Torque analysis: a leg that takes up weight, at three trunk loads (thesis, figures 30 and 34).

The robot stands on one tripod, the other three legs lifted. The tibia of the supporting middle leg
goes slowly from its original to an extended position, which lengthens the lever of the weight on
its femur. Joint torques are recovered from joint data alone (:mod:`.position_error`). A femur held
over its stall torque shuts down.

The thesis prints neither postures nor times; those below are assumed, and chosen so that the
loaded robot's femur comes to its stall torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from busemu.tables import Robot
from hal.cpg.gait import Gait
from hal.cpg.network import tripods
from hal.legs import PARTS, Legs, quantity

from ..recording import Recording
from ..running import Session
from .experiment import Choice, Progress, Trial
from .motion import Motion, load_register, moving, observe, shutdown_registers
from .position_error import TorqueSensor
from .rigs import only_hexapods
from .series import condition, cut_at_s, robot_of, samples, span_s
from .torque_analysis_result import Course, TorqueAnalysis
from .weighing import weigh

#: Joint angles of the stance, and of the lifted legs [rad]; assumed: standing high, so that the
#: foot of the extended tibia is not far above the other two.
STANCE = {"coxa": 0.0, "femur": 0.1, "tibia": -1.5}
LIFTED = {"femur": 1.3, "tibia": -1.2}
#: Tibia of the supporting middle leg, extended [rad]. Assumed.
EXTENDED_RAD = -0.2
STAND_S, RISE_S, LIFT_S, SETTLE_S = 1.5, 1.0, 1.0, 0.5
#: The robot is weighed as it sinks so far [m] and rises again, so long each way [s]. Assumed: slow,
#: and ten times what turns friction around.
SQUAT_M, SQUAT_S = 0.015, 2.0
#: Slow: a twentieth of either servo's no-load speed or less.
EXTEND_S = 8.0
#: Time in the extended position [s]: more than the second after which a stalled servo shuts down.
HOLD_S = 1.6
LOWER_S = 1.0
OBSERVE_S = 0.02


class TorqueAnalysisExperiment:
    """Runs, evaluates and draws the torque analysis."""

    name = "torque-analysis"
    title = "Torque analysis"
    figures = "30, 34"
    description = (
        "On three legs, the tibia of the middle one extends slowly, at three trunk loads: joint "
        "torques, and the load, from joint data alone; an overloaded femur shuts down."
    )

    def trials(self, robot: Robot, choice: Choice) -> tuple[Trial, ...]:
        """A trial a repeat and load: none, one and two battery packs more, as in the thesis."""
        only_hexapods(robot, self.name)
        pack_kg = quantity(robot.document, "trunk", "battery_kg")
        supporting, lifted = _tripods(robot)
        return tuple(
            Trial(
                name=f"{self.name}-load{number}-{repeat:02}",
                repeat=repeat,
                seed=choice.seed + repeat,
                seconds=STAND_S
                + RISE_S
                + LIFT_S
                + SETTLE_S
                + 2.0 * SQUAT_S
                + EXTEND_S
                + HOLD_S
                + LOWER_S,
                trunk_load_kg=round(number * pack_kg, 6),
                condition={
                    "leg": supporting[-1],
                    "supporting": list(supporting),
                    "lifted": list(lifted),
                },
            )
            for number in range(3)
            for repeat in range(1, choice.repeats + 1)
        )

    def preparation(self, robot: Robot, trial: Trial) -> str:
        """What a person must do with a real robot."""
        load = (
            f"Fix {trial.trunk_load_kg * 1e3:.0f} g to the middle of the trunk."
            if trial.trunk_load_kg
            else "Nothing but its own battery on the trunk."
        )
        lifted, leg = ", ".join(trial.condition["lifted"]), trial.condition["leg"]
        return (
            f"Put the robot on its belly on a floor it does not slip on. {load} It will stand up, "
            f"lift {lifted}, sink and rise, and stretch {leg} until that leg may give way: stay "
            "ready to catch it, and do not hold it."
        )

    def run(self, session: Session, trial: Trial, progress: Progress) -> Mapping[str, Any]:
        """Stand up, lift three legs, sink and rise, extend one tibia, hold, and come down."""
        robot = session.robot
        supporting, lifted = trial.condition["supporting"], trial.condition["lifted"]
        leg = str(trial.condition["leg"])
        gait, legs = Gait.of(robot), Legs.of(robot)
        neutral = {
            "coxa": gait.neutral_coxa_rad,
            "femur": gait.neutral_femur_rad,
            "tibia": gait.neutral_tibia_rad,
        }
        rng = np.random.default_rng(trial.seed)
        watched = [f"{name}.{part}" for name in supporting for part in PARTS]
        loads = sorted({load_register(robot, joint) for joint in watched})
        slow = ("present_voltage", *loads, *shutdown_registers(robot))
        seen = {f"rig/{joint}_nm" for joint in watched}
        seen |= {f"contact/{name}_n" for name in supporting}
        observe(session, OBSERVE_S, seen.__contains__)
        with moving(session, watched, progress, slow) as motion:
            every = motion.control.joints
            motion.go({joint: neutral[joint.partition(".")[2]] for joint in every}, STAND_S)
            motion.go({joint: STANCE[joint.partition(".")[2]] for joint in every}, RISE_S)
            up = {f"{name}.{part}": rad for name in lifted for part, rad in LIFTED.items()}
            motion.go(up, LIFT_S)
            motion.hold(SETTLE_S + 0.1 * float(rng.uniform()))
            weighing_s = _squat(motion, legs, supporting)
            began_s = motion.clock.now_s()
            seconds = EXTEND_S * float(rng.uniform(0.98, 1.02))
            motion.go({f"{leg}.tibia": EXTENDED_RAD}, seconds, smooth=False)
            motion.hold(HOLD_S)
            ended_s = motion.clock.now_s()
            down = {f"{name}.{part}": neutral[part] for name in lifted for part in PARTS}
            motion.go({**down, f"{leg}.tibia": STANCE["tibia"]}, LOWER_S)
        return {"weighing_s": list(weighing_s), "extending_s": [began_s, ended_s]}

    def evaluate(self, recordings: Sequence[Recording]) -> TorqueAnalysis:
        """Torques of every recording; ``payload_kg`` and ``leg`` stand in their conditions.

        The load is recovered where ``supporting`` and ``weighing_s`` stand there, too.
        """
        robot = robot_of(recordings, self.name)
        leg = str(condition(recordings[0], "leg"))
        courses, weighings, others, volts = [], [], set(), []
        sensor = None
        for recording in recordings:
            span = span_s(recording, "extending_s")
            load_kg = float(condition(recording, "payload_kg"))
            if "weighing_s" in recording.metadata.get("condition", {}):
                weighed = span_s(recording, "weighing_s")
                legs = [str(name) for name in condition(recording, "supporting")]
                weighings.append(weigh(recording, robot, legs, weighed, load_kg))
            for part in PARTS:
                joint = f"{leg}.{part}"
                sensor = TorqueSensor.of_recording(recording, robot, joint)
                found = samples(recording, robot, joint, span)
                cut_s = cut_at_s(recording, robot.by_joint[joint].servo_id, span)
                volts.append(float(np.median(found.voltage_v)))
                courses.append(
                    Course(
                        joint,
                        load_kg,
                        found.t_s - span[0],
                        found.position_rad + found.error_rad,
                        found.position_rad,
                        sensor.torque_nm(found.error_rad, found.voltage_v),
                        sensor.torque_past_friction_nm(
                            found.error_rad, found.voltage_v, found.position_rad
                        ),
                        found.true_nm,
                        float("nan") if cut_s is None else cut_s - span[0],
                    )
                )
            for servo_id in recording.servo_ids:
                other = robot.by_id[servo_id].joint
                if (
                    not other.startswith(f"{leg}.")
                    and cut_at_s(recording, servo_id, span) is not None
                ):
                    others.add(other)
        assert sensor is not None
        loads = tuple(sorted({course.load_kg for course in courses}))
        return TorqueAnalysis(
            robot=robot.name,
            leg=leg,
            repeats=max(
                sum(c.load_kg == kg and c.joint == f"{leg}.femur" for c in courses) for kg in loads
            ),
            loads_kg=loads,
            stall_nm=sensor.stall_nm,
            stall_at_nm=sensor.stall_at_nm(float(np.median(volts))),
            courses=tuple(courses),
            weighings=tuple(weighings),
            others_shut_down=tuple(sorted(others)),
        )

    def draw(self, result: TorqueAnalysis) -> Figure:
        """Motion of the tibia, and torques of the three joints."""
        from .figures.torque_analysis import torque_analysis_figure  # noqa: PLC0415

        return torque_analysis_figure(result)


def _tripods(robot: Robot) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The tripod to stand on, its middle leg last, and the one to lift."""
    legs = Legs.of(robot)
    standing, lifted = tripods(legs)
    from_middle = dict(zip(legs.names, np.abs(legs.hips_m[:, 1]).tolist(), strict=True))
    return tuple(sorted(standing, key=lambda name: -from_middle[name])), lifted


def _squat(motion: Motion, legs: Legs, supporting: Sequence[str]) -> tuple[float, float]:
    """Sink and rise on the supporting legs, feet in their places; from when to when [s].

    Every joint that carries turns both ways, so that friction is known: it is against the motion.
    """
    high = legs.stretched(STANCE["coxa"], STANCE["femur"], STANCE["tibia"])
    low = legs.angles_rad(legs.feet_m(high) + np.array((0.0, 0.0, SQUAT_M)))
    began_s = motion.clock.now_s()
    for angles_rad in (low, high):
        goals = dict(zip(legs.joints, angles_rad.ravel().tolist(), strict=True))
        there = {joint: rad for joint, rad in goals.items() if joint.split(".")[0] in supporting}
        motion.go(there, SQUAT_S, smooth=False)
    return began_s, motion.clock.now_s()
