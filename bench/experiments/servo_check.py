"""Servo check: torque against position error, with one joint blocked (thesis, figures 29 and 33).

The coxa of one leg is driven gently against a block, first on one side, then on the other, and its
goal goes on into the block and back: the position error grows from nothing to past full duty. The
leg is raised like a mast, so that it is light and clear of its neighbours. Emulated, the block is
the joint's mechanical stop; on a real robot it is a clamp.

A rig stays as it rests, and any of its joints can be checked; emulated, a clamp holds it.

Two lines come out. Duty against error needs ``present_load`` (or ``present_pwm``) only, and shows
the position law of any servo, real or not. Torque against error needs someone who knows the torque:
here what stands beside an emulated robot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from busemu.tables import Robot

from ..recording import Recording
from ..running import Session
from .experiment import Choice, ExperimentError, Progress, Trial
from .lines import Line, fit_line
from .motion import Motion, load_register, moving, observe, shutdown_registers
from .position_error import TorqueSensor
from .rigs import clamp_rad, is_rig, no_such_leg, rest_rad
from .series import Floats, condition, rms, robot_of, samples, spans_s
from .servo_check_result import ServoCheck

#: The raised leg [rad]; assumed: clear of its neighbours, and light to turn.
MAST = {"femur": 1.5, "tibia": 0.0}
RAISE_S = 1.5
#: Pace at which the block is looked for [rad/s], and how far the goal may run ahead of the joint
#: before it counts as blocked [rad]. Assumed: more than friction and lag of both servos need.
SEARCH_RAD_S = 0.6
BLOCKED_RAD = 0.06
#: A joint that stands still so long is stopped [s], and the goal moves on by no more than so much
#: time in one cycle [s]. Assumed.
STILL_S, LONGEST_STEP_S = 0.2, 0.02
#: How far past full duty the error goes, as a share of it. Assumed.
PAST = 1.25
#: Time of the goal into the block and back [s]; a fifth of it is at full duty, below the second
#: after which a servo protects itself.
SWEEP_S = 3.0
#: Errors within these shares of the full-duty error are on the straight line, clear of dead zone,
#: punch and friction's corner; those beyond the third are at the stall torque.
STRAIGHT, STALLED = (0.15, 0.8), 1.1
OBSERVE_S = 0.005


class ServoCheckExperiment:
    """Runs, evaluates and draws the servo check."""

    name = "servo-check"
    title = "Servo check"
    figures = "29, 33"
    description = (
        "One joint is blocked and commanded into the block, on both sides: torque against "
        "position error is a straight line that ends at the stall torque."
    )

    def trials(self, robot: Robot, choice: Choice) -> tuple[Trial, ...]:
        """One trial a repeat, trunk held; of a rig, whatever joint is wanted, clamped."""
        condition: dict[str, Any] = {}
        clamps: dict[str, tuple[float, float]] = {}
        if is_rig(robot):
            joint = choice.joint or robot.servos[0].joint
            if joint not in robot.by_joint:
                raise ExperimentError(
                    f"{robot.name} has no joint {joint}: use --joint "
                    f"{' or --joint '.join(robot.by_joint)}"
                )
            clamps[joint] = clamp_rad(robot, joint, PAST)
            condition["blocked_rad"] = list(clamps[joint])
        else:
            if choice.joint is not None:
                raise ExperimentError(
                    f"{robot.name} has legs, of which the coxa is checked: use --leg, not --joint"
                )
            joint = f"{choice.leg}.coxa"
            if joint not in robot.by_joint:
                raise no_such_leg(robot, choice.leg)
        return tuple(
            Trial(
                name=f"{self.name}-{repeat:02}",
                repeat=repeat,
                seed=choice.seed + repeat,
                seconds=RAISE_S + 4.0 * SWEEP_S,
                held=True,
                clamps=clamps,
                condition={"joint": joint, **condition},
            )
            for repeat in range(1, choice.repeats + 1)
        )

    def preparation(self, robot: Robot, trial: Trial) -> str:
        """What a person must do with a real robot."""
        joint = str(trial.condition["joint"])
        if is_rig(robot):
            low, high = trial.clamps[joint]
            return (
                f"{robot.name} goes to where its file has it at rest; then {joint} (servo "
                f"{robot.by_joint[joint].servo_id}) turns slowly one way and the other until it "
                f"meets a block. Fix two that stop it at about {math.degrees(low):.0f} and "
                f"{math.degrees(high):.0f} degrees, strong enough for the stall torque. Keep hands "
                "off."
            )
        leg = joint.partition(".")[0]
        return (
            f"Put the robot on a stand so that no foot touches anything. {leg} will rise until it "
            f"points up; then its coxa (servo {robot.by_joint[joint].servo_id}) turns slowly one "
            "way and the other until it meets a block. Fix two blocks that stop it well before "
            "the leg meets its neighbours, strong enough for the stall torque. Keep hands off."
        )

    def run(self, session: Session, trial: Trial, progress: Progress) -> Mapping[str, Any]:
        """Raise the leg, then press against the block on either side."""
        robot = session.robot
        joint = str(trial.condition["joint"])
        mount = robot.by_joint[joint]
        rng = np.random.default_rng(trial.seed)
        load = load_register(robot, joint)
        slow = (load, "present_voltage", *shutdown_registers(robot))
        observe(session, OBSERVE_S, {f"rig/{joint}_nm", f"rig/{joint}_rad"}.__contains__)
        spans: list[float] = []
        with moving(session, [joint], progress, slow) as motion:
            sensor = TorqueSensor.of(robot, mount, motion.law_registers[joint])
            depth_rad = PAST * sensor.full_error_rad
            motion.go(_posture(robot, trial), RAISE_S)
            for side in (-1.0, 1.0):
                blocked_rad = _find_block(motion, joint, side, sensor.count_rad)
                spans += _press(motion, joint, blocked_rad, side * depth_rad, rng)
        return {"pressing_s": spans}

    def evaluate(self, recordings: Sequence[Recording]) -> ServoCheck:
        """Fit the lines to all recordings together, and to each by itself for the spread."""
        robot = robot_of(recordings, self.name)
        joint = str(condition(recordings[0], "joint"))
        sensor = TorqueSensor.of_recording(recordings[0], robot, joint)
        each = [_points(recording, robot, joint) for recording in recordings]
        error, torque, load, voltage = (np.concatenate(part) for part in zip(*each, strict=True))
        rising = np.concatenate([_rising(part[0]) for part in each])
        slopes = [
            _lines(sensor, part[0], part[1], _rising(part[0]))[0].slope
            for part in each
            if not np.isnan(part[1]).all()
        ]
        line, friction = _lines(sensor, error, torque, rising)
        law, _ = _lines(sensor, error, load, rising)
        stalled = np.abs(error) > STALLED * sensor.full_error_rad
        known = not math.isnan(line.slope)
        ends = np.abs(torque[stalled])
        return ServoCheck(
            robot=robot.name,
            joint=joint,
            repeats=len(recordings),
            supply_v=float(np.median(voltage)),
            error_rad=error,
            torque_nm=torque,
            load=load,
            rising=rising,
            sensor=sensor,
            load_register=load_register(robot, joint),
            load_refresh_s=float(_drive_of(robot, joint).get("load_refresh_s", 0.0)),
            gain_per_rad=law.slope,
            gain_r2=law.r2,
            line=replace(line, spread=float(np.std(slopes))) if known else None,
            friction_nm=friction,
            stall_nm=float(np.mean(ends[~np.isnan(ends)])) if known else float("nan"),
            rmse_nm=rms(sensor.torque_nm(error, voltage) - torque),
        )

    def draw(self, result: ServoCheck) -> Figure:
        """Torque against position error, and duty against position error."""
        from .figures.servo_check import servo_check_figure  # noqa: PLC0415

        return servo_check_figure(result)


def _posture(robot: Robot, trial: Trial) -> dict[str, float]:
    """Where the joints are while one of them is pressed [rad]."""
    joint = str(trial.condition["joint"])
    if is_rig(robot):
        low, high = trial.clamps[joint]
        return {**rest_rad(robot), joint: 0.5 * (low + high)}
    leg = joint.partition(".")[0]
    return {f"{leg}.{part}": angle for part, angle in MAST.items()}


def _find_block(motion: Motion, joint: str, side: float, count_rad: float) -> float:
    """Turn a joint until something stops it; returns its angle there [rad].

    Stopped is a joint that stands still for a while although its goal is well ahead of it: one that
    only lags, after a stall of the bus or the host, moves on.
    """
    control = motion.control
    index = control.joints.index(joint)
    end_rad = float((control.upper_rad if side > 0.0 else control.lower_rad)[index])
    goal = furthest = motion.goals_rad[joint]
    before_s = moved_s = motion.clock.now_s()
    while True:
        (position,) = motion.cycle({joint: goal}).tolist()
        now_s = motion.clock.now_s()
        step_s, before_s = min(now_s - before_s, LONGEST_STEP_S), now_s
        if math.isnan(position):
            continue
        if side * (position - furthest) > count_rad:
            furthest, moved_s = position, now_s
        ahead = side * (goal - position)
        if ahead > BLOCKED_RAD and now_s - moved_s > STILL_S:
            return float(position)
        if ahead < 2.0 * BLOCKED_RAD:
            goal += side * SEARCH_RAD_S * step_s
        if side * (end_rad - goal) < 0.0:
            raise ExperimentError(
                f"{joint} turned to the end of its servo's range without meeting a block: "
                "fix one in its way"
            )


def _press(
    motion: Motion, joint: str, blocked_rad: float, depth_rad: float, rng: np.random.Generator
) -> list[float]:
    """Move the goal into the block and back; returns from when to when [s]."""
    control, index = motion.control, motion.control.joints.index(joint)
    lower, upper = float(control.lower_rad[index]), float(control.upper_rad[index])
    if not lower < blocked_rad + depth_rad < upper:
        raise ExperimentError(
            f"{joint} is blocked at {blocked_rad:.2f} rad, and full duty needs a goal "
            f"{abs(depth_rad):.2f} rad beyond, but its servo ends at {lower:.2f} and {upper:.2f} "
            "rad: block it nearer to the middle of its range"
        )
    motion.go({joint: blocked_rad}, 0.5)
    motion.hold(0.2 + 0.1 * float(rng.uniform()))
    seconds = SWEEP_S / 2.0 * float(rng.uniform(0.95, 1.05))
    began_s = motion.clock.now_s()
    motion.go({joint: blocked_rad + depth_rad}, seconds, smooth=False)
    motion.go({joint: blocked_rad}, seconds, smooth=False)
    return [began_s, motion.clock.now_s()]


def _points(
    recording: Recording, robot: Robot, joint: str
) -> tuple[Floats, Floats, Floats, Floats]:
    """Error [rad], true torque [N m], load as duty and voltage [V] of all spans of pressing."""
    mount = robot.by_joint[joint]
    loads = recording.si(mount.servo_id, load_register(robot, joint), "read")
    sign = mount.direction * float(_drive_of(robot, joint).get("load_sign", 1.0))
    parts = []
    for start_s, end_s in spans_s(recording, "pressing_s"):
        found = samples(recording, robot, joint, (start_s, end_s))
        load = np.full(len(found.t_s), np.nan)
        inside = (loads.t_sample_s >= start_s) & (loads.t_sample_s <= end_s)
        at = np.searchsorted(found.t_s, loads.t_sample_s[inside]) - 1
        load[np.maximum(at, 0)] = sign * loads.value[inside]
        parts.append((found.error_rad, found.true_nm, load, found.voltage_v))
    error, torque, load, volt = (np.concatenate(part) for part in zip(*parts, strict=True))
    return error, torque, load, volt


def _drive_of(robot: Robot, joint: str) -> Mapping[str, Any]:
    return robot.tables[robot.by_joint[joint].servo_id].drive


def _rising(error_rad: Floats) -> NDArray[np.bool_]:
    """Which samples lie on the way into a block: up to the largest error of their side."""
    rising = np.zeros(len(error_rad), dtype=bool)
    for side in (-1.0, 1.0):
        on_side = np.flatnonzero(side * error_rad > 0.0)
        if len(on_side):
            deep = side * error_rad[on_side]
            deepest = on_side[np.flatnonzero(deep == deep.max())]
            rising[on_side[0] : deepest[-1] + 1] = True
    return rising


def _lines(
    sensor: TorqueSensor, error: Floats, value: Floats, rising: NDArray[np.bool_]
) -> tuple[Line, float]:
    """The line that ``value`` follows, both sides folded onto one, and the half gap of both ways.

    The line is the mean of that into the block and that back.
    """
    low, high = (share * sensor.full_error_rad for share in STRAIGHT)
    depth, folded = np.abs(error), np.sign(error) * value
    straight = (depth > low) & (depth < high)
    ways = [fit_line(depth[straight & way], folded[straight & way]) for way in (rising, ~rising)]
    middle = 0.5 * (low + high)
    into, back = (way.slope * middle + way.offset for way in ways)
    line = Line(
        slope=0.5 * (ways[0].slope + ways[1].slope),
        offset=0.5 * (ways[0].offset + ways[1].offset),
        r2=min(way.r2 for way in ways),
    )
    return line, 0.5 * (back - into)
