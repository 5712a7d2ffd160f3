"""Replaying what a whole robot was told: its recorded commands, without a bus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.recording import JointTrack, Recording, RecordingError, joint_track
from bench.recording.rules import READ
from busemu.tables import Robot, ServoMount
from sim.drive import fields
from sim.drive.parameters import pack
from sim.floating.rollout import Start, rollout
from sim.model import read_model
from sim.observer import pose_seen
from sim.stepped import ON_GRID, TICK_S
from sim.tree import SEGMENTS, PhysicalRobot

from ..commands import drive_commands
from ..observed import Channel, held_at, shown_by

Floats = NDArray[np.float64]

HEIGHT = "mocap/base_z_m"  #: of the trunk; other outside channels depend on where one stands
#: how a trunk leans, by a sensor on it or by an observer: two angles about level axes
LEANS = (
    ("imu/roll_rad", "imu/pitch_rad"),
    ("mocap/base_roll_rad", "mocap/base_pitch_rad"),
)
OWN_LEAN = LEANS[1]  #: as the model's observer has them
VOLTAGES = ("present_voltage", "present_input_voltage")  #: registers of the supply's voltage
LOOK_EVERY = 10  #: ticks between two looks at the trunk, the supply and the feet
HELD_HEIGHT_M = 0.5  #: of a trunk held in the air
LEAST_SAMPLES = 20  #: positions below which a joint tells nothing
#: from a command's last byte at the host to the servo that has it; assumed of a USB adapter
LATE_S = 0.0015
SETTLE_S = 1.0  #: in which a replay that begins in the middle of a course only settles; assumed


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What a robot was told in one recording, and when each joint was sampled; for replays.

    A joint that nobody read has no samples, and does in replays what it was told. Joints are in the
    order of the robot file's servos. ``start`` (commands, joints) holds the drives' commands at
    first; ``events`` (n, 4) are time [s since the first], joint, field of :mod:`sim.drive.fields`
    and value, in order of time. Angles are the joints' own.
    """

    name: str
    group: str
    condition: Mapping[str, Any]
    start: Floats
    events: Floats
    first_rad: Floats
    sample_s: tuple[Floats, ...]
    wait_s: tuple[Floats, ...]  #: from instruction to sampling, of every sample
    position_rad: tuple[Floats, ...]
    quantum_rad: float
    goals: Mapping[str, tuple[Floats, Floats]]
    height: tuple[Floats, Floats] | None  #: times [s] and heights [m] of the trunk, if observed
    #: times [s] and angles [rad] (instants, 2) of how the trunk leans, if observed
    lean: tuple[Floats, Floats] | None = None
    #: times [s] and voltages [V] that servos had at their terminals, all of them, if any was read
    voltage: tuple[Floats, Floats] | None = None
    #: times [s] and duties that loads' registers told, joint by joint, in the servo's own sense
    duty: tuple[tuple[Floats, Floats], ...] = ()

    @property
    def end_s(self) -> float:
        """The last sample [s]."""
        return max(float(t[-1]) for t in self.sample_s if len(t))

    def at(self, t_s: float) -> Floats:
        """Recorded angles of all joints at an instant [rad], or goals where nobody read."""
        every = zip(self.goals.values(), self.sample_s, self.position_rad, strict=True)
        return np.array(
            [
                np.interp(t_s, t, angle) if len(t) else held_at(goal, np.array([t_s]))[0]
                for goal, t, angle in every
            ]
        )


def course(recording: Recording, robot: Robot) -> Course:
    """What a recording tells of a whole robot. Raises :class:`RecordingError`."""
    tracks = {mount.joint: joint_track(recording, mount.joint, robot) for mount in robot.servos}
    waits = {mount.joint: _waits_s(recording, mount.servo_id) for mount in robot.servos}
    seen = [joint for joint, t in tracks.items() if len(t.position_t_s) >= LEAST_SAMPLES]
    if not seen:
        raise RecordingError(
            recording.path,
            f"fewer than {LEAST_SAMPLES} positions of every joint: a whole robot is diagnosed from "
            "recordings that read present_position",
        )
    for joint, track in tracks.items():
        if joint not in seen:
            tracks[joint], waits[joint] = _unread(track, recording), np.empty(0)
    origin = min(float(tracks[joint].position_t_s[0]) for joint in seen) - 1e-3
    starts, events, firsts = [], [], []
    for number, mount in enumerate(robot.servos):
        track = tracks[mount.joint]
        times, angles = track.position_t_s, track.position_rad
        if mount.joint not in seen:
            times, angles = np.array([origin]), track.goal_rad[:1]
        servo_rad = np.array([mount.to_servo(angle) for angle in angles.tolist()])
        table = robot.tables[mount.servo_id]
        start, rows = drive_commands(recording, mount, table, times, servo_rad, origin)
        starts.append(start)
        events.append(np.insert(rows, 1, float(number), axis=1))
        firsts.append(angles[0])
    stacked = np.concatenate(events)
    watched = recording.observed(HEIGHT)
    return Course(
        name=recording.name,
        group=str(recording.metadata.get("group") or recording.name),
        condition=dict(recording.metadata.get("condition", {})),
        start=np.stack(starts, axis=1),
        events=stacked[np.argsort(stacked[:, 0], kind="stable")],
        first_rad=np.array(firsts),
        sample_s=tuple(
            track.position_t_s - origin + waits[joint] for joint, track in tracks.items()
        ),
        wait_s=tuple(waits.values()),
        position_rad=tuple(track.position_rad for track in tracks.values()),
        quantum_rad=max(abs(t["present_position"].si_scale) for t in robot.tables.values()),
        goals={joint: (track.goal_t_s - origin, track.goal_rad) for joint, track in tracks.items()},
        height=(watched.t_sample_s - origin, watched.value) if len(watched.value) else None,
        lean=_lean(recording, origin),
        voltage=_voltage(recording, robot, origin),
        duty=tuple(_duty(recording, robot, mount, origin) for mount in robot.servos),
    )


def _unread(track: JointTrack, recording: Recording) -> JointTrack:
    """A joint of which nobody knows more than what it was told."""
    if not len(track.goal_rad):
        raise RecordingError(
            recording.path,
            f"{track.joint} was neither read nor told anything: a whole robot is diagnosed from "
            "recordings that write goal_position of every joint, or read its present_position",
        )
    return replace(track, position_t_s=np.empty(0), position_rad=np.empty(0))


def _voltage(recording: Recording, robot: Robot, origin_s: float) -> tuple[Floats, Floats] | None:
    """Times [s] and values [V] of the servos' voltage registers together, if they were read."""
    found = [
        recording.si(mount.servo_id, name, READ)
        for mount in robot.servos
        for name in VOLTAGES
        if name in robot.tables[mount.servo_id]
    ]
    times = np.concatenate([series.t_sample_s for series in found]) - origin_s
    if len(times) < LEAST_SAMPLES:
        return None
    order = np.argsort(times, kind="stable")
    return times[order], np.concatenate([series.value for series in found])[order]


def _lean(recording: Recording, origin_s: float) -> tuple[Floats, Floats] | None:
    """Times [s] and angles [rad] (instants, 2) of the trunk about two axes, if both were seen."""
    for names in LEANS:
        one, other = (recording.observed(name) for name in names)
        if min(len(one.value), len(other.value)) >= LEAST_SAMPLES:
            beside = np.interp(one.t_sample_s, other.t_sample_s, other.value)
            return one.t_sample_s - origin_s, np.stack([one.value, beside], axis=1)
    return None


def _duty(
    recording: Recording, robot: Robot, mount: ServoMount, origin_s: float
) -> tuple[Floats, Floats]:
    """Times [s] and duties of a servo's load register, none where nobody read it."""
    table = robot.tables[mount.servo_id]
    shown = shown_by(recording, mount.servo_id, table, Channel.DUTY)
    if shown is None:
        return np.empty(0), np.empty(0)
    _, times, duty = shown
    return times - origin_s, duty


def _waits_s(recording: Recording, servo_id: int) -> Floats:
    """From instruction to sampling of every position that came [s]; 0 where nobody noted it."""
    return np.nan_to_num(recording.waits(servo_id, "present_position").own)


def loaded(robot: Robot, condition: Mapping[str, Any]) -> PhysicalRobot:
    """The robot of a file under a recording's condition, with the weight its trunk carried.

    ``payload_kg`` (or ``trunk_load_kg``) is spread over the trunk as the torque experiment does.
    """
    weight = float(condition.get("trunk_load_kg", condition.get("payload_kg", 0.0)))
    rest = {k: v for k, v in condition.items() if not k.startswith("payload")}
    return read_model(robot, trunk_load_kg=weight, condition=rest)


Span = tuple[float, float]  #: of a course [s]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A replay: sensed joint angles every tick (ticks, joints), and what was looked at meanwhile.

    ``height_m`` are heights of the trunk at ``look_t_s`` and ``lean_rad`` (looks, 2) its roll and
    pitch, none where nobody asks, ``voltage_v`` what drives had then, their mean; ``stands``
    (looks, legs) is whether a foot pressed on the ground. ``rest_m`` is the height of the trunk
    before it moved. ``span`` are the instants of the course at which the replay says something: not
    before it has settled, where it began in the middle.
    """

    angle_rad: Floats
    look_t_s: Floats
    height_m: Floats
    lean_rad: Floats
    voltage_v: Floats
    stands: NDArray[np.bool_]
    rest_m: float
    from_s: float
    span: Span

    def at(self, joint: int, t_s: Floats) -> Floats:
        """Sensed angle of a joint [rad] at ``t_s`` of the course."""
        at = np.clip((t_s - self.from_s) / TICK_S, 0.0, len(self.angle_rad) - 1.0)
        index = np.minimum(at.astype(np.intp), len(self.angle_rad) - 2)
        part = at - index
        column = self.angle_rad[:, joint]
        found: Floats = column[index] * (1.0 - part) + column[index + 1] * part
        return found


@dataclass(frozen=True, slots=True)
class Jitter:
    """How a replay starts a little otherwise: what contacts make of it is the spread of replays."""

    seed: int
    angle_rad: float = 0.002  #: deviation of the first joint angles; under a count of the sensor
    yaw_rad: float = 0.01

    def draw(self, joints: int) -> tuple[Floats, float]:
        """Offsets of the joints and of the heading [rad]."""
        random = np.random.default_rng([self.seed, 31])
        angles = self.angle_rad * random.standard_normal(joints)
        return angles, self.yaw_rad * random.standard_normal()


def _acts_s(events: Floats, delays_s: Sequence[float]) -> Floats:
    """When each event acts [s]: goals later by their joint's delay, or once it is switched on."""
    time_s, joint, field, value = events.T
    acts_s: Floats = time_s.copy()
    for j, delay_s in enumerate(delays_s):
        goals = (joint == j) & np.isin(field, fields.GOALS)
        on_s = time_s[(joint == j) & (field == fields.ENABLED) & (value > 0.0)]
        next_on_s = np.append(on_s, np.inf)[np.searchsorted(on_s, time_s[goals])]
        acts_s[goals] = np.minimum(time_s[goals] + delay_s, next_on_s)
    return acts_s


def play(
    robot: PhysicalRobot,
    course: Course,
    jitter: Jitter | None = None,
    span: Span | None = None,
) -> Track:
    """Replay a course with a robot, compiled (:mod:`sim.floating`).

    It starts where the joints were first read, on its belly or its feet; with a ``span``, where
    they were read at its beginning. Raises :class:`sim.entries.PhysicsError` for a gear too stiff
    for any step.
    """
    count = len(robot.joints)
    angles, yaw = jitter.draw(count) if jitter else (np.zeros(count), 0.0)
    offsets = np.array([j.drive.zero_offset_rad * j.direction for j in robot.joints])
    first = _posture(robot, course.first_rad - offsets + angles)
    posture = first if span is None else _posture(robot, course.at(span[0]) - offsets + angles)
    from_s, to_s = span or (0.0, course.end_s)
    held = course.condition.get("support") == "suspended"
    rest = HELD_HEIGHT_M if held else _height_m(robot, first)
    height = HELD_HEIGHT_M if held else _height_m(robot, posture)
    seen = rollout(
        robot,
        Start(posture, (0.0, 0.0, height), 0.0 if held else yaw, held),
        course.start,
        _events(robot, course, from_s),
        int(np.ceil((to_s - from_s) / TICK_S)) + 3,
        LOOK_EVERY,
    )
    watched = course.height is not None or course.lean is not None
    return Track(
        angle_rad=_as_sensed(robot, seen.angle_rad),
        look_t_s=from_s + seen.look_s,
        height_m=seen.origin_m[:, 2] if watched else np.empty(0),
        lean_rad=_leans(seen.frame) if watched else np.empty((0, len(OWN_LEAN))),
        voltage_v=seen.voltage_v,
        stands=np.stack([seen.pressed[f"{leg.name}.{SEGMENTS[-1]}"] for leg in robot.legs], axis=1),
        rest_m=rest,
        from_s=from_s,
        span=(from_s + SETTLE_S, to_s) if span else (-np.inf, np.inf),
    )


def _events(robot: PhysicalRobot, course: Course, from_s: float) -> Floats:
    """What drives are told, by the tick from which it holds: the first after it, as on a bus.

    When a servo's tick comes is its own matter, half a tick after a command on an average. So goals
    hold that late; where this falls within a tick, the law has the mean over that tick of what was
    wanted before and after. What a robot does changes smoothly then with when it was told.
    """
    joint, field, value = course.events[:, 1:].T
    delays = [each.drive.delay_s for each in robot.joints]
    at = (_acts_s(course.events, delays) + LATE_S - from_s) / TICK_S
    goals = np.isin(field, fields.GOALS)
    at[goals] -= 0.5
    due = np.floor(at + ON_GRID) + 1.0
    share = np.where(goals, np.minimum(due - at, 1.0), 1.0)  # of its tick in which it is wanted
    first = value + (1.0 - share) * (_before(course) - value)
    row = np.arange(len(value))
    told = np.column_stack([due, joint, field, first, row])
    then = np.column_stack([due + 1.0, joint, field, value, row])[share < 1.0 - ON_GRID]
    every = np.concatenate([told, then])
    ordered: Floats = every[np.lexsort((every[:, 4], every[:, 0])), :4]
    return ordered


def _before(course: Course) -> Floats:
    """What was wanted before each event that is a goal (events,), in its unit; others' own."""
    _, joint, field, value = course.events.T
    before: Floats = value.copy()
    for goal, j in product(fields.GOALS, range(course.start.shape[1])):
        own = np.flatnonzero((field == goal) & (joint == j))
        before[own] = np.append(course.start[goal, j], value[own])[: len(own)]
    return before


def _as_sensed(robot: PhysicalRobot, joint_rad: Floats) -> Floats:
    """What the servos' sensors make of the joints' angles, in the joints' frame."""
    params = pack([joint.drive for joint in robot.joints])
    sign = np.array([float(j.direction) for j in robot.joints])
    zero = np.array([j.zero_rad for j in robot.joints])
    wave = params[fields.WAVE] * np.sin(
        params[fields.WAVE_PERIODS] * (joint_rad - zero) * sign + params[fields.WAVE_PHASE]
    )
    sensed: Floats = joint_rad + sign * (params[fields.ZERO_OFFSET] + wave)
    return sensed


def _leans(frame: Floats) -> Floats:
    """Roll and pitch of frames (looks, 3, 3), as an observer has them."""
    seen = [pose_seen((0.0, 0.0, 0.0), one.ravel().tolist()) for one in frame]
    return np.array([[pose[name] for name in OWN_LEAN] for pose in seen])


def _posture(robot: PhysicalRobot, angle_rad: Floats) -> dict[str, float]:
    return {j.name: float(q) for j, q in zip(robot.joints, angle_rad, strict=True)}


def _height_m(robot: PhysicalRobot, posture: Mapping[str, float]) -> float:
    """Height of the trunk frame with belly or feet on the ground, legs each in their posture."""
    assert robot.trunk is not None
    feet = [
        leg.foot.radius_m - leg.foot_m({s: posture[f"{leg.name}.{s}"] for s in SEGMENTS})[2]
        for leg in robot.legs
    ]
    return max(*feet, -robot.trunk.belly_m)
