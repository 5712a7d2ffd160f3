"""One fault as somebody asks for it: what goes wrong, with what, and when."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from ..protocol import Instruction
from ..tables import Robot


class FaultError(ValueError):
    """A fault that cannot be had: says the file, the entry, the rule and what to do."""


class Kind(enum.Enum):
    """What can go wrong."""

    DROP = "drop"  #: a packet is not there
    DELAY = "delay"  #: a servo answers late
    CORRUPT = "corrupt"  #: bits of a packet are flipped
    TRUNCATE = "truncate"  #: a packet breaks off
    SPLIT = "split"  #: a reply has a pause in it
    DUPLICATE = "duplicate"  #: a reply comes twice
    NOISE = "noise"  #: random bytes before a packet
    LATENCY = "latency"  #: adapter or host are late with a reply that was on time on the wire
    DUPLICATE_ID = "duplicate_id"  #: a servo has the ID of another one
    DEAD = "dead"  #: a servo has no power
    BROWN_OUT = "brown_out"  #: the supply fails for a moment, and servos start up again
    OVERLOAD = "overload"  #: a servo raises its overload alarm
    OVERHEAT = "overheat"  #: a servo is too hot
    ENCODER_STUCK = "encoder_stuck"  #: a servo's position sensor stays where it is
    UNPLUG = "unplug"  #: the port goes away, and comes back


_WINDOW = ("servo", "after_s", "for_s")
_PACKET = (*_WINDOW, "register", "instruction", "count", "probability")
#: The keys that each kind of fault may have.
KEYS: Mapping[Kind, tuple[str, ...]] = MappingProxyType(
    {
        Kind.DROP: (*_PACKET, "on"),
        Kind.DELAY: (*_PACKET, "delay_s"),
        Kind.CORRUPT: (*_PACKET, "on", "bits"),
        Kind.TRUNCATE: (*_PACKET, "on", "bytes"),
        Kind.SPLIT: (*_PACKET, "gap_s"),
        Kind.DUPLICATE: _PACKET,
        Kind.NOISE: (*_PACKET, "on", "bytes"),
        Kind.LATENCY: (*_PACKET, "delay_s"),
        Kind.DUPLICATE_ID: (*_WINDOW, "id"),
        Kind.DEAD: _WINDOW,
        Kind.BROWN_OUT: _WINDOW,
        Kind.OVERLOAD: ("servo", "after_s"),
        Kind.OVERHEAT: (*_WINDOW, "temperature_c"),
        Kind.ENCODER_STUCK: _WINDOW,
        Kind.UNPLUG: ("after_s", "for_s"),
    }
)
#: What holds where nothing is said. All assumed: of a size that a program has to bear. A delay is
#: one that the official SDK still waits for (34 ms), a latency spike one that it does not.
DEFAULTS: Mapping[tuple[Kind, str], float] = MappingProxyType(
    {
        (Kind.DELAY, "delay_s"): 0.02,
        (Kind.LATENCY, "delay_s"): 0.05,
        (Kind.SPLIT, "gap_s"): 0.005,
        (Kind.CORRUPT, "bits"): 1,
        (Kind.NOISE, "bytes"): 4,
        (Kind.BROWN_OUT, "for_s"): 0.05,
    }
)
#: Longest delay and pause [s]; most bits and bytes. They bound what a bus has to hold.
MOST_S, MOST = 10.0, 1000
#: Faults that strike packets; the others befall servos or the port.
STRIKE_PACKETS = frozenset(kind for kind, keys in KEYS.items() if "probability" in keys)


@dataclass(frozen=True, slots=True)
class Fault:
    """What shall go wrong. Made by :func:`parse_fault`; times are in s after it was asked for."""

    kind: Kind
    servos: tuple[int, ...] = ()  #: IDs; empty for any
    register: str | None = None
    instruction: Instruction | None = None
    on_instruction: bool = False  #: it strikes instructions instead of replies
    after_s: float = 0.0
    for_s: float = math.inf
    count: int | None = None
    probability: float = 1.0
    delay_s: float = 0.0
    gap_s: float = 0.0
    bits: int = 0
    size: int | None = None  #: ``bytes``; ``None`` for a random number of them
    temperature_c: float | None = None
    new_id: int = 0

    @property
    def strikes_packets(self) -> bool:
        """Whether it strikes packets; otherwise it befalls servos, or the port."""
        return self.kind in STRIKE_PACKETS

    def __str__(self) -> str:
        """The fault on one line: ``corrupt servo 3, bits 2, probability 0.01``."""
        words = [self.kind.value.replace("_", "-")]
        if self.servos:
            words[0] += f" servo {', '.join(map(str, self.servos))}"
        for name, value, unless in (
            ("id", self.new_id, 0),
            ("instruction", self.instruction and self.instruction.name.lower(), None),
            ("register", self.register, None),
            ("on", "instruction" if self.on_instruction else "", ""),
            ("bits", self.bits, 0),
            ("bytes", self.size, None),
            ("delay-s", self.delay_s, 0.0),
            ("gap-s", self.gap_s, 0.0),
            ("temperature-c", self.temperature_c, None),
            ("after-s", self.after_s, 0.0),
            ("for-s", self.for_s, math.inf),
            ("count", self.count, None),
            ("probability", self.probability, 1.0),
        ):
            if value != unless:
                words.append(f"{name} {value}")
        return ", ".join(words)


def parse_fault(fields: Mapping[str, Any], where: str, robot: Robot) -> Fault:
    """Check what was asked for. ``where`` says where it stands; raises :class:`FaultError`."""
    fault = _Asked(fields, where, robot)
    kind = fault.kind()
    return Fault(
        kind,
        servos=fault.servos(),
        register=fault.register(),
        instruction=fault.instruction(),
        on_instruction=fault.choice("on", ("reply", "instruction")) == "instruction",
        after_s=fault.number("after_s", 0.0, math.inf) or 0.0,
        for_s=_or(fault.number("for_s", 0.0, math.inf), math.inf),
        count=fault.whole("count", 1, None),
        probability=_or(fault.number("probability", 0.0, 1.0), 1.0),
        delay_s=fault.number("delay_s", 0.0, MOST_S) or 0.0,
        gap_s=fault.number("gap_s", 0.0, MOST_S) or 0.0,
        bits=fault.whole("bits", 1, MOST) or 0,
        size=fault.whole("bytes", 1, MOST),
        temperature_c=fault.number("temperature_c", -50.0, 200.0),
        new_id=fault.new_id(),
    )


def _or(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


class _Asked:
    """The fields of a fault, read one by one; each complaint says where it stands."""

    def __init__(self, fields: Mapping[str, Any], where: str, robot: Robot) -> None:
        self._fields = fields
        self._where = where
        self._robot = robot
        self._kind = Kind.DROP

    def _wrong(self, what: str) -> FaultError:
        return FaultError(f"{self._where}: {what}")

    def kind(self) -> Kind:
        word = self._fields.get("kind")
        known = {kind.value: kind for kind in Kind}
        if not isinstance(word, str) or word.replace("-", "_") not in known:
            have = f"not {word!r}" if word is not None else "which is missing"
            raise self._wrong(f"kind must be one of {', '.join(known)}, {have}")
        self._kind = known[word.replace("-", "_")]
        for key in self._fields:
            if key != "kind" and key not in KEYS[self._kind]:
                have = ", ".join(KEYS[self._kind])
                raise self._wrong(
                    f"{self._kind.value} has no {key!r}: remove it, or use one of {have}"
                )
        return self._kind

    def _get(self, key: str) -> Any:
        return self._fields.get(key, DEFAULTS.get((self._kind, key)))

    def number(self, key: str, least: float, most: float) -> float | None:
        value = self._get(key)
        if value is None:
            return None
        if type(value) not in (int, float) or not least <= value <= most:
            span = f"from {least:g} to {most:g}" if most < math.inf else f"of {least:g} or more"
            raise self._wrong(f"{key} must be a number {span}, not {value!r}")
        return float(value)

    def whole(self, key: str, least: int, most: int | None) -> int | None:
        value = self._get(key)
        if value is None:
            return None
        if type(value) is not int or value < least or (most is not None and value > most):
            span = f"from {least} to {most}" if most is not None else f"of {least} or more"
            raise self._wrong(f"{key} must be a whole number {span}, not {value!r}")
        return value

    def choice(self, key: str, words: tuple[str, ...]) -> str:
        value = self._fields.get(key, words[0])
        if value not in words:
            raise self._wrong(f"{key} must be {' or '.join(words)}, not {value!r}")
        return str(value)

    def servos(self) -> tuple[int, ...]:
        value = self._fields.get("servo", [])
        ids = value if isinstance(value, list) else [value]
        known = ", ".join(map(str, sorted(self._robot.by_id)))
        for servo_id in ids:
            if type(servo_id) is not int or servo_id not in self._robot.by_id:
                raise self._wrong(
                    f"servo {servo_id!r} is not on {self._robot.name}: its IDs are {known}"
                )
        if self._kind is Kind.DUPLICATE_ID and len(ids) != 1:
            raise self._wrong("duplicate_id needs one servo: the one that has the wrong ID")
        return tuple(dict.fromkeys(ids))

    def register(self) -> str | None:
        name = self._fields.get("register")
        if name is None:
            return None
        tables = self._robot.tables
        chosen = self.servos() or tuple(tables)
        if not any(name in tables[servo_id] for servo_id in chosen):
            table = tables[chosen[0]]
            raise self._wrong(
                f"{table.model} has no register {name!r}: see busemu tables {table.model}"
            )
        return str(name)

    def instruction(self) -> Instruction | None:
        word = self._fields.get("instruction")
        if word is None:
            return None
        known = {each.name.lower(): each for each in Instruction if each.name != "STATUS"}
        if not isinstance(word, str) or word not in known:
            raise self._wrong(f"instruction must be one of {', '.join(known)}, not {word!r}")
        return known[word]

    def new_id(self) -> int:
        if self._kind is not Kind.DUPLICATE_ID:
            return 0
        value = self.whole("id", 0, 252)
        if value is None:
            raise self._wrong("duplicate_id needs id: the ID that the servo has by mistake")
        return value
