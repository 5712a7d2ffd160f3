"""What a recording tells of one joint: what went in, and what was seen, channel by channel."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.recording import Recording, RecordingError
from bench.recording.rules import READ
from busemu.tables import ControlTable, Robot
from sim.drive import fields, lanes
from sim.rollout import Replay

from .commands import drive_commands, supply_events
from .periods import own_period
from .posture import recorded_posture
from .smooth import follows, smooth

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

LOAD = "present_load"  #: the duty, of some models with its sign exchanged
TURN_RAD = 2.0 * np.pi
DUTY = "foreign/goal_duty"  #: namespace of a duty that no register holds, share of full duty
LEAST_SAMPLES = 20  #: below this a recording says nothing about a joint
TURN_COUNTS = 4096  #: of an encoder that has no ends
MOTION_QUANTA = 20.0  #: that goals must span to ask for a motion; assumed
FIRST_SAMPLES, FIRST_S = 5, 0.01  #: that tell how fast a joint is at first, whichever is more
#: between a voltage's values, beyond which currents come and go: between two that are read less,
#: as a goal that is written makes a current that is over some 10 ms later, when the motor has come
#: up to speed, and goals are written in step with reads; assumed
SELDOM_S, SELDOM_READ_S = 0.05, 0.025
#: how much older a voltage may be than the time between two of them, and how old at most: one that
#: is asked for once a second was not measured a second ago; assumed
LATE_S, OLDEST_S = 0.02, 0.15
UNLOADED = 0.9  #: quantile of such voltages that is taken for that without load; assumed
#: steps of its register by which a voltage must go up and down to be one that a motion was under:
#: a step of 0.1 V is 2 % of 5 V, and what the rounding hides makes a motion wrong by up to half
EVEN_STEPS = 2.0
RARE = 0.005  #: share of its values that may be farther off, and are wrong; assumed
STILL_QUANTA = 4.0  #: a joint that moves less at the beginning is taken to rest


class Channel(enum.Enum):
    """A signal of a servo: the registers that may bring it, and the rollouts' column for it."""

    POSITION = ("position", ("present_position",), lanes.OUT_POSITION)
    DUTY = ("duty", ("present_pwm", "present_load"), lanes.OUT_DUTY)
    VOLTAGE = ("voltage", ("present_input_voltage", "present_voltage"), lanes.OUT_VOLTAGE)

    def __init__(self, word: str, registers: tuple[str, ...], column: int) -> None:
        self.word = word
        self.registers = registers
        self.column = column


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """One channel over time, shape (n,): times [s since the replay began], values in SI.

    ``index`` is their place among the replay's samples; ``quantum`` the register's step. ``good``
    is false where a value stands alone against its neighbours (a failed read that was logged).
    """

    register: str
    t_s: Floats
    value: Floats
    quantum: float
    index: NDArray[np.intp]
    good: Mask


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """One joint in one recording; angles are the servo's own."""

    name: str
    group: str
    joint: str
    condition: Mapping[str, Any]
    replay: Replay
    channels: Mapping[Channel, Samples]
    goal: tuple[Floats, Floats]  #: times [s] and goal positions [rad] as the controller got them
    registers: Mapping[str, int]  #: of the servo, as the metadata has them
    posture_rad: Floats | None = None  #: of all joints of an arm, (n, joints), over the replay
    supplied: bool = False  #: whether the replay's supply is the voltage that was read
    volts_s: float = 0.0  #: period in which that is read or renewed [s]
    seldom: bool = False  #: whether currents come and go between its values

    @property
    def position(self) -> Samples:
        """The channel every joint has."""
        return self.channels[Channel.POSITION]

    @property
    def motion(self) -> tuple[Floats, Floats, Floats]:
        """Times [s], goals in force and angles [rad] of all good positions; a goal may be NaN."""
        samples = self.position
        t_s = samples.t_s[samples.good]
        goal = held_at(self.goal, t_s)
        if self.replay.start[fields.MODE] != fields.MODE_POSITION:
            goal = np.full(len(t_s), np.nan)
        return t_s, goal, samples.value[samples.good]

    @property
    def stale_s(self) -> float:
        """How old a voltage may be that is told so seldom, nobody knows exactly when [s]."""
        return min(self.volts_s + LATE_S, OLDEST_S)

    def driven(self, t_s: Floats) -> Mask:
        """Whether the torque was on, at times [s] of any shape."""
        told = self.replay.events[self.replay.events[:, 1] == fields.ENABLED]
        on = np.append(self.replay.start[fields.ENABLED], told[:, 2]) > 0.0
        return np.asarray(on[np.searchsorted(told[:, 0], t_s, side="right")])

    def parts(self) -> list[Any]:
        """All that residuals depend on, as arrays and plain values."""
        replay = self.replay
        told: list[Any] = [self.name, self.group, self.joint]
        told.append(sorted(self.condition.items(), key=str))
        told += [replay.start, replay.events, replay.samples]
        told += [
            replay.position_rad,
            replay.velocity_rad_s,
            replay.held_rad,
            replay.rests,
            self.posture_rad,
            self.supplied,
            self.volts_s,
            self.seldom,
        ]
        for channel, samples in self.channels.items():
            told += [channel.word, samples.register, samples.t_s, samples.value, samples.good]
        return told


def observe(
    recordings: Sequence[Recording],
    robot: Robot,
    joint: str,
    *,
    supply_from_register: bool = True,
    needed: bool = True,
    like: Sequence[Observed] = (),
) -> list[Observed]:
    """What some recordings tell of one joint of a robot.

    Where a voltage register was read, the replay's supply is what it says (a channel of its own
    then judges what made the voltage). Where that tells of it too seldom, it is what it says
    without load; and where it hardly changes but for its rounding, its mean. ``like`` are
    recordings of the same joint that were observed before. Recordings with too few positions are
    left out. Raises :class:`RecordingError` when none is left and one is ``needed``.
    """
    found = []
    for recording in recordings:
        one = _observe(recording, robot, joint)
        if one is not None:
            found.append(one)
    if supply_from_register:
        supply = _Supply.of([*like, *found])
        found = [supply.under(one) for one in found]
    if needed and not found:
        raise RecordingError(
            recordings[0].path if recordings else None,
            f"no recording has {LEAST_SAMPLES} positions of joint {joint!r} and a write to its "
            "servo: record goals and present_position",
        )
    return found


def left_out(recordings: Sequence[Recording], used: Sequence[Observed]) -> tuple[str, ...]:
    """Which recordings told too little of a joint to be used, in one line or none."""
    names = {one.name for one in used}
    silent = [recording.name for recording in recordings if recording.name not in names]
    if not silent:
        return ()
    return (
        f"left out, less than {LEAST_SAMPLES} positions of the joint, or it is stuck: "
        + ", ".join(silent),
    )


def stuck(one: Observed) -> bool:
    """Whether a joint stands still while its goals move: torque off, or a read that failed."""
    samples = one.position
    moved = float(np.ptp(one.goal[1])) > MOTION_QUANTA * samples.quantum
    return moved and float(np.ptp(samples.value[samples.good])) == 0.0


def shown_by(
    recording: Recording, servo_id: int, table: ControlTable, channel: Channel
) -> tuple[str, Floats, Floats] | None:
    """The register that brought a channel, times [s] and values, a duty in the servo's own sense.

    ``None`` where nobody read any of its registers.
    """
    for register in channel.registers:
        if (servo_id, register, READ) in recording.by_series:
            times, values = recording.si(servo_id, register, READ)
            if len(times):
                sign = float(table.drive.get("load_sign", 1.0)) if register == LOAD else 1.0
                return register, times, sign * values
    return None


def _observe(recording: Recording, robot: Robot, joint: str) -> Observed | None:
    mount = robot.by_joint[joint]
    servo_id = mount.servo_id
    table = robot.tables[servo_id]
    series = {}
    for channel in Channel:
        shown = shown_by(recording, servo_id, table, channel)
        if shown is not None:
            register, times, values = shown
            waits = recording.waits(servo_id, register)
            times = times + np.nan_to_num(waits.own - waits.first)
            series[channel] = (register, times, values, abs(table[register].si_scale))
    if Channel.POSITION not in series or len(series[Channel.POSITION][1]) < LEAST_SAMPLES:
        return None
    register, times, angles, quantum = series[Channel.POSITION]
    angles = unwrapped(angles, quantum)
    series[Channel.POSITION] = register, times, angles, quantum
    good = sound(times, angles, quantum)
    origin = float(min(entry[1][0] for entry in series.values())) - 1e-3
    start, events = drive_commands(recording, mount, table, times[good], angles[good], origin)
    if len(robot.servos) == 1:
        start, events = _with_duty(recording, start, events, origin)
    union = np.unique(np.concatenate([entry[1] for entry in series.values()])) - origin
    channels = {}
    for channel, (register, t, value, step) in series.items():
        channels[channel] = Samples(
            register,
            t - origin,
            value,
            step,
            np.searchsorted(union, t - origin),
            good if channel is Channel.POSITION else lonely(value, step),
        )
    velocity = _first_velocity(times[good], angles[good], quantum)
    is_goal = events[:, 1] == fields.GOAL_POSITION
    goal_t = np.concatenate([[0.0], events[is_goal, 0]])
    goal = np.concatenate([[start[fields.GOAL_POSITION]], events[is_goal, 2]])
    condition = recording.metadata.get("condition", {})
    return Observed(
        name=recording.name,
        group=str(recording.metadata.get("group") or recording.name),
        joint=joint,
        condition=condition,
        replay=Replay(start, events, union, float(angles[good][0]), velocity),
        channels=channels,
        goal=(goal_t, goal),
        registers={
            name: int(raw)
            for name, raw in recording.metadata.get("servo", {})
            .get(str(servo_id), {})
            .get("registers", {})
            .items()
        },
        posture_rad=recorded_posture(recording, robot, joint, origin, float(union[-1])),
    )


@dataclass(frozen=True, slots=True)
class _Supply:
    """What some recordings' voltages tell of the supply; ``level_v`` is one for all of them."""

    period_s: float = 0.0  #: in which a voltage is read or renewed; 0 without one
    seldom: bool = False
    even: bool = False
    level_v: float | None = None

    @classmethod
    def of(cls, some: Sequence[Observed]) -> _Supply:
        """The period is that of most recordings."""
        volts = [one.channels[Channel.VOLTAGE] for one in some if Channel.VOLTAGE in one.channels]
        if not volts:
            return cls()
        steps = [float(np.median(np.diff(v.t_s))) for v in volts if len(v.t_s) > 1]
        seen = own_period((v.t_s, v.value) for v in volts)
        read_s, new_s = float(np.median(steps)) if steps else 0.0, seen[0] if seen else 0.0
        period_s = max(read_s, new_s)
        quantum = volts[0].quantum
        swing = [np.ptp(np.quantile(v.value[v.good], [RARE, 1.0 - RARE])) for v in volts]
        means = [float(np.mean(v.value[v.good])) for v in volts]
        return cls(
            period_s,
            read_s > SELDOM_READ_S or period_s > SELDOM_S,
            bool(max(swing) < (EVEN_STEPS + 0.5) * quantum),
            float(np.mean(means)) if np.ptp(means) < 1.5 * quantum else None,
        )

    def under(self, one: Observed) -> Observed:
        """A recording whose replay is under this supply."""
        volts = one.channels.get(Channel.VOLTAGE)
        if volts is None:
            return one
        t_s, value = volts.t_s[volts.good], volts.value[volts.good]
        supplied = not self.seldom and not self.even
        if self.even:
            level_v = float(np.mean(value)) if self.level_v is None else self.level_v
            t_s, value = t_s[:1], np.array([level_v])
        elif not supplied:
            t_s, value = t_s[:1], np.quantile(value, [UNLOADED])
        supply = supply_events(t_s, value)
        supply[0, 0] = 0.0
        events = np.concatenate([one.replay.events, supply])
        events = events[np.argsort(events[:, 0], kind="stable")]
        replay = replace(one.replay, events=events)
        return replace(
            one, replay=replay, supplied=supplied, volts_s=self.period_s, seldom=self.seldom
        )


def _first_velocity(t_s: Floats, angles: Floats, quantum: float) -> float:
    """Speed [rad/s] at the first sample: of a parabola, where a joint moves from the beginning."""
    count = max(FIRST_SAMPLES, int(np.searchsorted(t_s, t_s[0] + FIRST_S)))
    t, first = t_s[:count] - t_s[0], angles[:count]
    if np.ptp(first) <= STILL_QUANTA * quantum:
        return 0.0
    return float(np.polyfit(t, first, 2 if count > FIRST_SAMPLES else 1)[-2])


def _with_duty(
    recording: Recording, start: Floats, events: Floats, origin_s: float
) -> tuple[Floats, Floats]:
    """Commands of firmware that applies a logged duty directly, where there is one."""
    if (0, DUTY, "read") not in recording.by_series:
        return start, events
    times, duty = recording.series(0, DUTY, "read")
    if not len(duty):
        return start, events
    start = start.copy()
    start[fields.MODE], start[fields.ENABLED] = fields.MODE_PWM, 1.0
    start[fields.GOAL_DUTY] = duty[max(0, int(np.searchsorted(times, origin_s, "right")) - 1)]
    first = np.flatnonzero(np.diff(duty, prepend=duty[0]) != 0.0)
    first = first[times[first] > origin_s]
    field = np.full(len(first), float(fields.GOAL_DUTY))
    rows = np.stack([times[first] - origin_s, field, duty[first]], axis=1)
    events = np.concatenate([events, rows])
    return start, events[np.argsort(events[:, 0], kind="stable")]


def unwrapped(angles: Floats, quantum: float) -> Floats:
    """Angles [rad] of an encoder without ends, gone on beyond the end of its turn; others as is."""
    counts = TURN_RAD / quantum
    if abs(counts - round(counts)) > 1e-6 * counts or round(counts) != TURN_COUNTS:
        return angles
    turned: Floats = np.asarray(np.unwrap(angles), np.float64)
    return angles if (np.abs(turned - angles) < 0.5 * quantum).all() else turned


def held_at(goal: tuple[Floats, Floats], t_s: Floats) -> Floats:
    """The goal in force [rad]; before the first write the first."""
    at = np.searchsorted(goal[0], t_s, side="right") - 1
    held: Floats = goal[1][np.maximum(at, 0)]
    return held


def sound(t_s: Floats, angles: Floats, quantum: float) -> Mask:
    """Where angles [rad], shape (n,), are no glitches, though they stand out on a smooth motion."""
    usual = lonely(angles, quantum) | follows(t_s, angles, quantum)
    return usual & smooth(t_s, angles, quantum)


def lonely(values: Floats, quantum: float) -> Mask:
    """Where a value is no glitch: not far off both its neighbours while they agree.

    Far is more than eight steps of the register and eight times what neighbours usually differ.
    That holds for any register; of angles :func:`bench.diagnosis.smooth.smooth` sees more.
    """
    if len(values) < 5:
        return np.ones(len(values), bool)
    padded = np.pad(values, 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 5)
    middle = np.median(windows, axis=1)
    usual = np.median(np.abs(np.diff(values))) if len(values) > 1 else 0.0
    spread = np.abs(windows[:, [1, 3]] - middle[:, None]).max(axis=1)
    far = np.abs(values - middle)
    result: Mask = ~(far > np.maximum(8.0 * quantum, 8.0 * usual) + 3.0 * spread)
    return result
