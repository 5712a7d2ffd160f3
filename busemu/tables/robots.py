"""Robot files: which servo sits at which joint, on which bus.

One TOML file a robot, under ``busemu/tables/robots/``. The bus, the robot's own software and the
simulator all start from the same file; each reads the part that is its own. This module reads the
part that all need: the wiring.

Servos that hang on nothing but a bus need no file: ``XM430-W350:1-3,7`` stands for four servos of
that model with these IDs, at the baud rate from the factory, and ``XM430-W350:1-3,7@1000000`` for
the same at another one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from .control_table import ControlTable, TableError, load_table
from .toml_file import read_toml

ROBOTS = Path(__file__).with_name("robots")
FORMAT = "busemu-robot/1"
#: No servo here goes beyond 4.5 Mbaud; assumed: some more may come.
FASTEST_BAUD = 20_000_000
#: Largest ``zero_rad``: ten turns, as far as any multi-turn rig is described; assumed.
LARGEST_ZERO_RAD = 20.0 * math.pi
#: Servos without a file: a model or the path of its table, IDs, a baud rate.
_SERVOS = re.compile(r"(?P<model>.+):(?P<ids>[0-9,-]*)(@(?P<baud_rate>[0-9]+))?")
_ID_RANGE = re.compile(r"([0-9]{1,3})(?:-([0-9]{1,3}))?")


class RobotError(ValueError):
    """A robot file that cannot be used: says the file, the entry, the rule and what to do."""


@dataclass(frozen=True, slots=True)
class ServoMount:
    """A servo at its joint: ``servo = direction * (joint - zero)``, both in rad.

    ``zero_rad`` is the joint's angle when the servo is at the centre of its range.
    """

    servo_id: int
    model: str
    joint: str
    direction: int = 1
    zero_rad: float = 0.0
    registers: Mapping[str, int] = field(default_factory=dict)

    def to_servo(self, joint_rad: float) -> float:
        """The servo's angle [rad] at a joint angle [rad]."""
        return self.direction * (joint_rad - self.zero_rad)

    def to_joint(self, servo_rad: float) -> float:
        """The joint's angle [rad] at a servo angle [rad]."""
        return self.direction * servo_rad + self.zero_rad


@dataclass(frozen=True)
class Robot:
    """A robot as its file describes it; ``document`` is the whole file."""

    name: str
    path: Path
    protocol: float
    baud_rate: int
    timing: str
    servos: tuple[ServoMount, ...]
    document: Mapping[str, Any]

    @property
    def has_bodies(self) -> bool:
        """Whether the file says what an engine needs, and not only what is on the bus."""
        return "supply" in self.document

    @cached_property
    def by_id(self) -> Mapping[int, ServoMount]:
        """Servos by their ID on the bus."""
        return MappingProxyType({s.servo_id: s for s in self.servos})

    @cached_property
    def by_joint(self) -> Mapping[str, ServoMount]:
        """Servos by the joint they move."""
        return MappingProxyType({s.joint: s for s in self.servos})

    @cached_property
    def tables(self) -> Mapping[int, ControlTable]:
        """Control tables by servo ID."""
        return MappingProxyType({s.servo_id: load_table(s.model) for s in self.servos})


def robots() -> tuple[str, ...]:
    """Names of the robots that come with the package, sorted."""
    return tuple(sorted(path.stem for path in ROBOTS.glob("*.toml")))


def load_robot(name_or_path: str | Path) -> Robot:
    """A robot by the name of a file that comes with the package, or by a path to a TOML file.

    Or servos without a file, such as ``XM430-W350:1-3,7`` (see the module).

    Raises :class:`RobotError` with one line that says what is wrong and what to do.
    """
    servos = _SERVOS.fullmatch(str(name_or_path))
    if servos is not None:
        return parse_robot(_bare(servos), Path(name_or_path))
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = ROBOTS / f"{name_or_path}.toml"
        if not path.is_file():
            raise RobotError(
                f"no robot named {str(name_or_path)!r}: use one of {', '.join(robots())}, "
                "the path of a robot file ending in .toml, or servos such as XM430-W350:1-3"
            )
    return parse_robot(read_toml(path, RobotError), path)


def _bare(servos: re.Match[str]) -> dict[str, Any]:
    """The document of servos that hang on nothing but a bus. Raises :class:`RobotError`."""
    where, model = servos.string, servos["model"]
    try:
        table = load_table(model)
    except TableError as error:
        raise RobotError(f"{where}: {error}") from None
    register = table.by_name.get("baud_rate")
    factory = table.baud_rates.get(register.initial or 0 if register else 0, 1_000_000)
    return {
        "format": FORMAT,
        "name": table.model,
        "bus": {
            "protocol": table.protocol,
            "baud_rate": int(servos["baud_rate"] or factory),
            "servo_model": model,
        },
        "servo": [{"id": i, "joint": f"servo{i}"} for i in _ids(servos["ids"], where)],
    }


def _ids(words: str, where: str) -> Iterator[int]:
    for word in words.split(","):
        found = _ID_RANGE.fullmatch(word)
        first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
        if last < first:
            raise RobotError(f"{where}: IDs are written as 1-3,7, not {words!r}")
        yield from range(first, last + 1)


def parse_robot(document: Mapping[str, Any], path: Path) -> Robot:
    """Check the wiring of a robot document. Raises :class:`RobotError`."""
    if document.get("format") != FORMAT:
        raise RobotError(f'{path}: needs the line format = "{FORMAT}" at its top')
    bus = document.get("bus", {})
    if not isinstance(bus, Mapping):
        raise RobotError(f"{path}: [bus] must be a table")
    for key in ("protocol", "baud_rate"):
        if key not in bus:
            raise RobotError(f"{path}: [bus] needs {key}")
    if bus["protocol"] not in (1.0, 2.0):
        raise RobotError(f"{path}: [bus] protocol must be 1.0 or 2.0, not {bus['protocol']!s:.40}")
    if type(bus["baud_rate"]) is not int or not 1 <= bus["baud_rate"] <= FASTEST_BAUD:
        raise RobotError(
            f"{path}: [bus] baud_rate must be a whole number of 1 to {FASTEST_BAUD} baud, not "
            f"{bus['baud_rate']!s:.40}"
        )
    rows = document.get("servo", [])
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        raise RobotError(f"{path}: servos are listed as [[servo]]")
    if not rows:
        raise RobotError(f"{path}: no [[servo]] is listed")
    servos = tuple(_mount(row, bus, path) for row in rows)
    for what, values in (
        ("id", [str(s.servo_id) for s in servos]),
        ("joint", [s.joint for s in servos]),
    ):
        twice = sorted({value for value in values if values.count(value) > 1})
        if twice:
            raise RobotError(f"{path}: servo {what} {', '.join(twice)} is there twice")
    return Robot(
        name=str(document.get("name", path.stem)),
        path=path,
        protocol=float(bus["protocol"]),
        baud_rate=bus["baud_rate"],
        timing=str(bus.get("timing", "ideal")),
        servos=servos,
        document=MappingProxyType(dict(document)),
    )


def _mount(row: Mapping[str, Any], bus: Mapping[str, Any], path: Path) -> ServoMount:
    where = f"{path}: [[servo]] id {row.get('id', '?')!s:.40}"
    missing = {"id", "joint"} - set(row)
    unknown = set(row) - {"id", "joint", "model", "direction", "zero_rad", "registers"}
    if missing or unknown:
        problem = f"needs {', '.join(sorted(missing))}" if missing else ""
        problem = problem or f"unknown key {', '.join(sorted(unknown))}"
        raise RobotError(f"{where}: {problem}")
    highest = 253 if bus["protocol"] == 1.0 else 252
    if type(row["id"]) is not int or not 0 <= row["id"] <= highest:
        raise RobotError(f"{where}: an id is a whole number from 0 to {highest}")
    model = row.get("model", bus.get("servo_model"))
    if model is None:
        raise RobotError(f"{where}: needs model, or [bus] servo_model")
    try:
        table = load_table(str(model))
    except TableError as error:
        raise RobotError(f"{where}: {error}") from None
    if table.protocol != bus["protocol"]:
        raise RobotError(
            f"{where}: {model} speaks Protocol {table.protocol}, the bus {bus['protocol']}"
        )
    if row.get("direction", 1) not in (1, -1):
        raise RobotError(f"{where}: direction must be 1 or -1, not {row['direction']!s:.40}")
    if type(row.get("zero_rad", 0.0)) not in (int, float):
        raise RobotError(f"{where}: zero_rad must be a number, not {row['zero_rad']!r}")
    if not abs(row.get("zero_rad", 0.0)) <= LARGEST_ZERO_RAD:
        raise RobotError(
            f"{where}: zero_rad = {row['zero_rad']!s:.40} rad is not within "
            f"{-LARGEST_ZERO_RAD:.4g} to {LARGEST_ZERO_RAD:.4g} rad"
        )
    for name, raw in row.get("registers", {}).items():
        if name not in table:
            raise RobotError(f"{where}: {model} has no register {name!r}")
        register = table[name]
        if type(raw) is not int or not 0 <= raw <= register.raw_maximum:
            raise RobotError(
                f"{where}: register {name} cannot hold {raw!r}: it is a whole number from 0 to "
                f"{register.raw_maximum}"
            )
        if not register.minimum <= register.decode(raw) <= register.maximum:
            raise RobotError(
                f"{where}: register {name} = {raw} is outside "
                f"{register.minimum} to {register.maximum}"
            )
    return ServoMount(
        servo_id=row["id"],
        model=str(model),
        joint=str(row["joint"]),
        direction=row.get("direction", 1),
        zero_rad=float(row.get("zero_rad", 0.0)),
        registers=MappingProxyType(dict(row.get("registers", {}))),
    )
