"""A shadow of a real bus: the emulated one beside it, given the same instructions at the same time.

Where the two answer differently, one of them is not what the other was made for. Readings are
compared in SI, and part when they are further apart than a threshold for :data:`HOLD_S`. Two things
the shadow cannot know at the start, and finds out:

* **settings**: a register that can be written and that the program has not written since the
  start is learned from the real servo's answer;
* **where a joint stands**: what depends on that is compared once torque has been on, on a goal
  given since the start, for :data:`SETTLE_S`.
"""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from busemu.assemble import assemble, plants
from busemu.plant import Plant
from busemu.protocol import Framer
from busemu.servo import Servo
from busemu.tables import Register, Robot, load_robot
from busemu.timing import load_profile
from busemu.wording import amount
from hal.access import Access

from .wire_decoder import WireDecoder

#: Readings part when they are too far apart for so long [s]; a single glitch is none. Assumed.
HOLD_S = 0.1
#: A joint that was told where to go is where it belongs after so long [s]. Assumed.
SETTLE_S = 2.0
#: A packet may have a pause of so long in it, for the sake of the program's writes [s].
PAUSE_S = 0.1
#: Readings wait so long at most for their counterparts, in number.
WAITING = 4000
#: How far readings may be apart, by unit of :attr:`~busemu.tables.Register.si_unit`. Assumed:
#: several times what sensors of these servos resolve. Loads are shares of 1.
THRESHOLDS: Mapping[str, float] = MappingProxyType(
    {"rad": 0.09, "rad/s": 1.0, "": 0.3, "A": 0.3, "V": 0.5, "degC": 15.0}
)
#: The shadow stands behind a USB2AX, too, which waits no longer than this for a servo [s].
AT_ONCE_S = math.ulp(0.0)
#: Registers that two servos need not have alike.
FREE = frozenset({"realtime_tick", "moving", "moving_status", "hardware_error_status"})
#: Registers whose value depends on where the joint stands.
STANDING = ("present_", "position_trajectory", "velocity_trajectory")
GOALS = ("goal_position", "goal_velocity", "goal_pwm", "goal_current", "moving_speed")


class ShadowError(ValueError):
    """A shadow that cannot stand beside the robot: says why."""


@dataclass(frozen=True, slots=True)
class Parting:
    """A reading that is not what the shadow expects; values in ``unit`` (SI), NaN for silence."""

    t_s: float  #: when it was read [s, monotonic clock]
    since_s: float  #: since when they are apart [s, the same clock]
    servo_id: int
    register: str
    expected: float
    seen: float
    unit: str
    over: bool = False  #: whether they are together again

    def words(self, start_s: float) -> str:
        """One line for a person; instants count from ``start_s``."""
        where = f"servo {self.servo_id} {self.register}"
        if self.over:
            return f"{self.t_s - start_s:8.2f} s  {where}: together again"
        expected, seen = (_words(value, self.unit) for value in (self.expected, self.seen))
        since_s = self.since_s - start_s
        return f"{since_s:8.2f} s  {where}: expected {expected}, seen {seen}"


@dataclass(slots=True)
class Pair:
    """One register of one servo on both buses."""

    compared: int = 0
    beyond: int = 0
    worst: float = 0.0  #: largest difference [SI]
    partings: int = 0
    first_s: float = math.nan  #: when they parted first [s]
    since_s: float = math.nan  #: since when they are apart; NaN when together
    parted: bool = False


@dataclass(slots=True)
class _Driven:
    """What the program has told one servo."""

    written: set[str] = field(default_factory=set)
    torque: bool = False
    settled_s: float = math.inf


class Shadow:
    """The emulated bus of ``robot`` beside a real one of the same wiring.

    ``tell`` is called when readings part and when they are together again. ``thresholds`` by
    register or unit come before :data:`THRESHOLDS`. Raises :class:`ShadowError`.
    """

    def __init__(
        self,
        robot: Robot,
        plant: Plant,
        start_s: float,
        tell: Callable[[Parting], object],
        thresholds: Mapping[str, float] = THRESHOLDS,
    ) -> None:
        self.pairs: dict[tuple[int, str], Pair] = {}
        self._robot = robot
        self._tell = tell
        self._thresholds = {**THRESHOLDS, **thresholds}
        profile = replace(load_profile("instant"), usb2ax_timeout_s=AT_ONCE_S)
        self._bus = assemble(robot, plant, profile, start_s=start_s)
        self._decoder = WireDecoder(robot.protocol, robot.tables, self._expect)
        self._framer = Framer(robot.protocol)
        self._held, self._heard_s = b"", start_s
        self._servos = {
            mount.servo_id: servo
            for mount, servo in zip(robot.servos, self._bus.servos, strict=True)
        }
        self._driven = {servo_id: _Driven() for servo_id in self._servos}
        self._expected: OrderedDict[tuple[float, int, str], float] = OrderedDict()
        self._seen: OrderedDict[tuple[float, int, str], float] = OrderedDict()

    def check(self, real: Robot) -> None:
        """Raise where the shadow has not the servos of ``real``."""
        mine, theirs = (
            {mount.servo_id: mount.model for mount in robot.servos} for robot in (self._robot, real)
        )
        if mine != theirs or self._robot.protocol != real.protocol:
            odd = sorted(i for i in {*mine, *theirs} if mine.get(i) != theirs.get(i))
            raise ShadowError(
                f"--shadow {self._robot.name}: not the servos of {real.name}"
                + (f" (IDs {', '.join(map(str, odd))})" if odd else "")
                + ": give a robot file of the same wiring"
            )

    # -- what passes ---------------------------------------------------------------------------

    def advance(self, to_s: float) -> None:
        """Let the shadow's joints go on, up to ``to_s`` [s, the clock of the chunks]."""
        self._bus.poll(to_s)
        self._bus.advance_plant(to_s)

    @property
    def now_s(self) -> float:
        """How far its joints have gone [s]."""
        return self._bus.plant_s

    def sent(self, data: bytes, t_s: float, baud_rate: int) -> None:
        """Bytes of the program, which had left at ``t_s`` [s] at ``baud_rate`` [bit/s]."""
        self._bus.baud_rate = baud_rate or self._bus.baud_rate
        if self._held and t_s - self._heard_s > PAUSE_S:
            self._framer.abort()
            self._held = b""
        self._heard_s = t_s
        self._framer.feed(data)
        held = self._held + data
        whole, self._held = held[: (split := len(held) - self._framer.pending)], held[split:]
        self._bus.poll(t_s)
        self._bus.receive(whole, t_s)
        answer = self._bus.poll(t_s)
        self._decoder.sent(data, t_s)
        if answer:
            self._decoder.received(answer, t_s)

    def seen(self, access: Access) -> None:
        """An access on the real bus, when all is known of it."""
        if access.servo_id not in self._servos:
            return
        if access.op == "write":
            self._note(access)
        else:
            self._match(access, self._seen, self._expected)

    def _expect(self, access: Access) -> None:
        if access.op == "read" and access.servo_id in self._servos:
            self._match(access, self._expected, self._seen)

    def _note(self, access: Access) -> None:
        driven = self._driven[access.servo_id]
        driven.written.add(access.register)
        if access.register == "torque_enable":
            driven.torque = bool(access.raw)
        if not driven.torque:
            driven.settled_s = math.inf
        elif access.register in GOALS and math.isinf(driven.settled_s):
            driven.settled_s = access.t_s + SETTLE_S

    def _match(
        self,
        access: Access,
        own: OrderedDict[tuple[float, int, str], float],
        others: OrderedDict[tuple[float, int, str], float],
    ) -> None:
        key = (access.t_s, access.servo_id, access.register)
        if key not in others:
            own[key] = access.raw
            if len(own) > WAITING:
                own.popitem(last=False)
            return
        other = others.pop(key)
        expected, seen = (access.raw, other) if own is self._expected else (other, access.raw)
        self._compare(key, expected, seen)

    # -- the difference --------------------------------------------------------------------------

    def _compare(self, key: tuple[float, int, str], expected: float, seen: float) -> None:
        t_s, servo_id, name = key
        servo = self._servos[servo_id]
        if name not in servo.table or name in FREE:
            return
        register, driven = servo.table[name], self._driven[servo_id]
        if register.writable and name not in driven.written:
            self._learn(servo, register, seen)
            return
        stands = name.startswith(STANDING) and register.unit not in ("V", "degC")
        if stands and t_s < driven.settled_s:
            return
        values = [
            math.nan if math.isnan(raw) else register.to_si(int(raw)) for raw in (expected, seen)
        ]
        self._judge(key, register, *values)

    def _learn(self, servo: Servo, register: Register, seen: float) -> None:
        if not math.isnan(seen) and servo.memory[register.name] != int(seen):
            servo.learn(register.name, int(seen))

    def _judge(
        self, key: tuple[float, int, str], register: Register, expected: float, seen: float
    ) -> None:
        t_s, servo_id, name = key
        pair = self.pairs.setdefault((servo_id, name), Pair())
        pair.compared += 1
        silent = math.isnan(expected) or math.isnan(seen)
        apart = 0.0 if silent else abs(seen - expected)
        pair.worst = max(pair.worst, apart)
        if apart <= self._threshold(register) and math.isnan(expected) == math.isnan(seen):
            if pair.parted:
                self._tell(
                    Parting(
                        t_s, pair.since_s, servo_id, name, expected, seen, register.si_unit, True
                    )
                )
            pair.parted, pair.since_s = False, math.nan
            return
        pair.beyond += 1
        if math.isnan(pair.since_s):
            pair.since_s = t_s
        if not pair.parted and t_s - pair.since_s >= HOLD_S:
            pair.parted = True
            pair.partings += 1
            if pair.partings == 1:
                pair.first_s = pair.since_s
            self._tell(Parting(t_s, pair.since_s, servo_id, name, expected, seen, register.si_unit))

    def _threshold(self, register: Register) -> float:
        """How far readings of a register may be apart [SI]; not at all, if it is a setting."""
        if register.name in self._thresholds:
            return self._thresholds[register.name]
        if register.area == "EEPROM" or register.writable:
            return 0.0
        return self._thresholds.get(register.si_unit, 0.0)

    def summary(self, start_s: float) -> list[str]:
        """What a whole run comes to; instants count from ``start_s``."""
        compared = sum(pair.compared for pair in self.pairs.values())
        parted = sorted(
            (item for item in self.pairs.items() if item[1].partings),
            key=lambda item: item[1].first_s,
        )
        lines = [
            f"shadow: {amount(compared, 'reading')} compared, "
            f"{amount(len(parted), 'register')} parted"
        ]
        for (servo_id, name), pair in parted:
            unit = self._robot.tables[servo_id][name].si_unit
            lines.append(
                f"  servo {servo_id} {name}: first at {pair.first_s - start_s:.2f} s, "
                f"{amount(pair.partings, 'time')}, {pair.beyond} of {pair.compared} readings, "
                f"at worst by {_words(pair.worst, unit)}" + ("; still apart" if pair.parted else "")
            )
        return lines


def shadow_of(
    name: str,
    plant: str,
    real: Robot,
    tell: Callable[[Parting], object],
    thresholds: Mapping[str, float],
) -> Shadow:
    """A shadow by the name of its robot and plant; its time begins now. Raises its errors."""
    robot = load_robot(name)
    makers = plants()
    if plant not in makers:
        raise ShadowError(f"no plant named {plant!r}: use one of {', '.join(makers)}")
    joints = makers[plant](robot)
    shadow = Shadow(robot, joints, time.monotonic(), tell, thresholds)
    shadow.check(real)
    return shadow


def parse_thresholds(words: list[str]) -> dict[str, float]:
    """``rad=0.05`` or ``present_position=0.05``, in SI. Raises :class:`ShadowError`."""
    found = {}
    for word in words:
        name, equals, value = word.partition("=")
        try:
            found[name] = float(value)
        except ValueError:
            found[name] = math.nan
        if not equals or not found[name] >= 0.0:
            raise ShadowError(
                f"--threshold {word}: give a register or a unit and a number in SI, "
                "such as present_position=0.05 or rad=0.05"
            )
    return found


def _words(value: float, unit: str) -> str:
    return "silence" if math.isnan(value) else f"{value:.4g} {unit}".rstrip()
