"""Torque analysis: a leg that takes up weight, at three trunk loads (thesis, figures 30 and 34).

The robot stands on one tripod, the other three legs lifted. The tibia of the supporting middle leg
goes slowly from its original to an extended position, which lengthens the lever of the weight on
its femur. Joint torques are recovered from joint data alone (:mod:`.position_error`). A femur held
over its stall torque shuts down.

The thesis prints neither postures nor times; those below are assumed, and chosen so that the
loaded robot's femur comes to its stall torque.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from busemu.tables import Robot
from hal.cpg.gait import Gait
from hal.cpg.network import tripods
from hal.legs import PARTS, Legs, quantity

from ..recording import Recording
from ..running import Session
from .experiment import RAW_DATA, Choice, Comparison, Progress, Trial
from .motion import SLOW_EVERY_S, moving, observe, shutdown_registers
from .position_error import TorqueSensor
from .series import Floats, condition, cut_at_s, rms, robot_of, samples, span_s

#: Joint angles of the stance, and of the lifted legs [rad]; assumed: standing high, so that the
#: foot of the extended tibia is not far above the other two.
STANCE = {"coxa": 0.0, "femur": 0.1, "tibia": -1.5}
LIFTED = {"femur": 1.3, "tibia": -1.2}
#: Tibia of the supporting middle leg, extended [rad]. Assumed.
EXTENDED_RAD = -0.2
STAND_S, RISE_S, LIFT_S, SETTLE_S = 1.5, 1.0, 1.0, 0.5
#: Slow: a twentieth of either servo's no-load speed or less.
EXTEND_S = 8.0
#: Time in the extended position [s]: more than the second after which a stalled servo shuts down.
HOLD_S = 1.6
LOWER_S = 1.0
OBSERVE_S = 0.02
#: A shutdown is seen so long after it at most [s]: its register is read at this pace.
SEEN_LATE_S = 1.5 * SLOW_EVERY_S
#: RMSE of torque in the thesis, in units of the stall torque.
THESIS_RMSE = {"phantomx": "0.17 to 0.20", "marvin": "0.001 to 0.04"}


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """One joint in one repeat while the tibia extends; arrays of shape (samples,)."""

    joint: str
    load_kg: float
    t_s: Floats  #: since the tibia began to move
    goal_rad: Floats
    position_rad: Floats
    torque_nm: Floats  #: from the position error, duty times stall torque
    past_friction_nm: Floats  #: the same, with friction against the joint's last motion
    true_nm: Floats  #: NaN where nobody knew it
    shut_down_s: float  #: NaN if it did not

    @property
    def before(self) -> NDArray[np.bool_]:
        """Which samples surely lie before a shutdown, shape (samples,)."""
        return ~(self.t_s >= self.shut_down_s - SEEN_LATE_S)


@dataclass(frozen=True, slots=True, eq=False)
class TorqueAnalysis:
    """Torques of the supporting middle leg, a course a joint, repeat and load."""

    robot: str
    leg: str
    repeats: int
    loads_kg: tuple[float, ...]
    stall_nm: float  #: of the data sheet
    stall_at_nm: float  #: of the drive at the voltage measured
    courses: tuple[Course, ...]
    others_shut_down: tuple[str, ...]  #: joints of the other two supporting legs that shut down

    def of(self, part: str, load_kg: float) -> list[Course]:
        """Courses of one joint (``"femur"``) at one load, a repeat each."""
        joint = f"{self.leg}.{part}"
        return [c for c in self.courses if c.joint == joint and c.load_kg == load_kg]

    def rmse_of_stall(self, part: str, load_kg: float, *, past_friction: bool = False) -> float:
        """RMS of recovered minus true torque until a shutdown, in stall torques; NaN if unknown."""
        every = [
            ((c.past_friction_nm if past_friction else c.torque_nm) - c.true_nm)[c.before]
            for c in self.of(part, load_kg)
        ]
        return rms(np.concatenate(every)) / self.stall_nm

    def peak_of_stall(self, part: str, load_kg: float, *, true: bool = False) -> float:
        """Largest torque on average over repeats, in stall torques; true or recovered."""
        peaks = [
            np.max(np.abs((c.true_nm if true else c.torque_nm)[c.before]))
            for c in self.of(part, load_kg)
        ]
        return float(np.mean(peaks)) / self.stall_nm

    def shut_down(self, load_kg: float) -> int:
        """In how many repeats at one load the femur shut down."""
        return sum(not math.isnan(c.shut_down_s) for c in self.of("femur", load_kg))

    def numbers(self) -> dict[str, Any]:
        """All numbers, as JSON can hold them."""
        table = []
        for load_kg in self.loads_kg:
            joints = {}
            for part in PARTS:
                cuts = [c.shut_down_s for c in self.of(part, load_kg)]
                cuts = [cut for cut in cuts if not math.isnan(cut)]
                joints[part] = {
                    "rmse_of_stall": self.rmse_of_stall(part, load_kg),
                    "rmse_past_friction_of_stall": self.rmse_of_stall(
                        part, load_kg, past_friction=True
                    ),
                    "peak_of_stall": self.peak_of_stall(part, load_kg),
                    "true_peak_of_stall": self.peak_of_stall(part, load_kg, true=True),
                    "repeats_shut_down": len(cuts),
                    "shut_down_after_s": float(np.mean(cuts)) if cuts else None,
                }
            table.append({"load_kg": load_kg, "joints": joints})
        return {
            "leg": self.leg,
            "repeats": self.repeats,
            "stall_torque_nm": self.stall_nm,
            "stall_torque_at_supply_nm": self.stall_at_nm,
            "loads": table,
            "others_shut_down": list(self.others_shut_down),
        }

    def comparisons(self) -> tuple[Comparison, ...]:
        """Numbers beside the thesis's."""
        found = []
        moved = ("femur", "tibia")  # the coxa carries nothing here
        for past_friction, how in ((False, "duty x stall"), (True, "and friction by last motion")):
            errors = [
                self.rmse_of_stall(part, kg, past_friction=past_friction)
                for part in moved
                for kg in self.loads_kg
            ]
            if any(math.isnan(error) for error in errors):
                continue
            found.append(
                Comparison(
                    f"RMSE of femur and tibia torque ({how})",
                    f"{min(errors):.3f} to {max(errors):.3f} x stall",
                    f"{THESIS_RMSE.get(self.robot, '(another robot)')} x stall",
                    "ours is position error against the true torque of the same robot, the "
                    f"thesis's is model against real robot; {RAW_DATA}",
                )
            )
        cut = [kg for kg in self.loads_kg if self.shut_down(kg)]
        found.append(
            Comparison(
                "femur over its stall torque",
                "shuts down at " + ", ".join(f"+{kg:.3f} kg" for kg in cut) if cut else "never",
                "loaded robots: servos shut down, a plateau",
            )
        )
        return tuple(found)

    def findings(self) -> tuple[str, ...]:
        """What a reader should know."""
        found = []
        for kg in self.loads_kg:
            peak_nm = self.peak_of_stall("femur", kg) * self.stall_nm
            cuts = self.shut_down(kg)
            what = f"shut down in {cuts} of {self.repeats} repeats" if cuts else "did not shut down"
            found.append(
                f"+{kg:.3f} kg: femur of {self.leg} to {peak_nm:.3f} N m, "
                f"{peak_nm / self.stall_at_nm:.0%} of the stall torque at its voltage; it {what}"
            )
        if self.others_shut_down:
            found.append(f"shut down as well: {', '.join(self.others_shut_down)}")
        return tuple(found)


class TorqueAnalysisExperiment:
    """Runs, evaluates and draws the torque analysis."""

    name = "torque-analysis"
    title = "Torque analysis"
    figures = "30, 34"
    description = (
        "On three legs, the tibia of the middle one extends slowly, at three trunk loads: joint "
        "torques from joint data alone; an overloaded femur shuts down."
    )

    def trials(self, robot: Robot, choice: Choice) -> tuple[Trial, ...]:
        """A trial a repeat and load: none, one and two battery packs more, as in the thesis."""
        pack_kg = quantity(robot.document, "trunk", "battery_kg")
        supporting, lifted = _tripods(robot)
        return tuple(
            Trial(
                name=f"{self.name}-load{number}-{repeat:02}",
                repeat=repeat,
                seed=choice.seed + repeat,
                seconds=STAND_S + RISE_S + LIFT_S + SETTLE_S + EXTEND_S + HOLD_S + LOWER_S,
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
        return (
            f"Put the robot on its belly on a floor it does not slip on. {load} It will stand up, "
            f"lift {', '.join(trial.condition['lifted'])} and stretch {trial.condition['leg']} "
            "until that leg may give way: stay ready to catch it, and do not hold it."
        )

    def run(self, session: Session, trial: Trial, progress: Progress) -> Mapping[str, Any]:
        """Stand up, lift three legs, extend one tibia, hold, and come down."""
        robot = session.robot
        supporting, lifted = trial.condition["supporting"], trial.condition["lifted"]
        leg = str(trial.condition["leg"])
        gait = Gait.of(robot)
        neutral = {
            "coxa": gait.neutral_coxa_rad,
            "femur": gait.neutral_femur_rad,
            "tibia": gait.neutral_tibia_rad,
        }
        rng = np.random.default_rng(trial.seed)
        watched = [f"{name}.{part}" for name in supporting for part in PARTS]
        slow = ("present_voltage", *shutdown_registers(robot))
        observe(session, OBSERVE_S, {f"rig/{leg}.{part}_nm" for part in PARTS}.__contains__)
        with moving(session, watched, progress, slow) as motion:
            every = motion.control.joints
            motion.go({joint: neutral[joint.partition(".")[2]] for joint in every}, STAND_S)
            motion.go({joint: STANCE[joint.partition(".")[2]] for joint in every}, RISE_S)
            up = {f"{name}.{part}": rad for name in lifted for part, rad in LIFTED.items()}
            motion.go(up, LIFT_S)
            motion.hold(SETTLE_S + 0.1 * float(rng.uniform()))
            began_s = motion.clock.now_s()
            seconds = EXTEND_S * float(rng.uniform(0.98, 1.02))
            motion.go({f"{leg}.tibia": EXTENDED_RAD}, seconds, smooth=False)
            motion.hold(HOLD_S)
            ended_s = motion.clock.now_s()
            down = {f"{name}.{part}": neutral[part] for name in lifted for part in PARTS}
            motion.go({**down, f"{leg}.tibia": STANCE["tibia"]}, LOWER_S)
        return {"extending_s": [began_s, ended_s]}

    def evaluate(self, recordings: Sequence[Recording]) -> TorqueAnalysis:
        """Torques of every recording; ``payload_kg`` and ``leg`` stand in their conditions."""
        robot = robot_of(recordings, self.name)
        leg = str(condition(recordings[0], "leg"))
        courses, others, volts = [], set(), []
        sensor = None
        for recording in recordings:
            span = span_s(recording, "extending_s")
            load_kg = float(condition(recording, "payload_kg"))
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
