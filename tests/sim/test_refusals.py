"""Whatever is no number, wherever a robot file or a world has one: refused in one line."""

from __future__ import annotations

import copy
import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from busemu.tables import RobotError, load_robot
from busemu.tables.robots import ROBOTS, parse_robot
from hal.cpg import LocomotionController
from hal.legs import UnreachableError
from sim.effects import catalogue
from sim.model import read_model
from sim.scene import read_scene

#: No number of any file may be one of these. TOML knows whole numbers of any length.
NOWHERE = (math.nan, 10**400, -(10**400), "abc", [1.0])

WORLD = """
format = "busemu-world/1"
ground = { friction = 1.0, stiffness_n_m = 5e3, damping_n_s_m = 10.0, pitch_rad = 0.1 }
payload = { mass_kg = 0.2, at_m = [0.0, 0.0, 0.03] }
slab = [{ at_m = [0.0, 0.5], size_m = [1.0, 0.2], height_m = 0.01, yaw_rad = 0.0, friction = 0.3 }]
push = [{ at_s = 3.0, for_s = 0.1, force_n = [2.0, 0.0, 0.0], at_m = [0.0, 0.0, 0.0] }]
"""

Way = tuple[str | int, ...]


def numbers(entry: Any, way: Way = ()) -> Iterator[Way]:
    """The way to every number of a document."""
    if isinstance(entry, dict):
        for key, below in entry.items():
            yield from numbers(below, (*way, key))
    elif isinstance(entry, list):
        for at, below in enumerate(entry):
            yield from numbers(below, (*way, at))
    elif isinstance(entry, int | float):
        yield way


def with_other(document: Any, way: Way, value: Any) -> Any:
    """The document with another value at the end of a way."""
    other = copy.deepcopy(document)
    at = other
    for key in way[:-1]:
        at = at[key]
    at[way[-1]] = value
    return other


def opened(path: Path, document: Any) -> None:
    """Write a robot or a world, and open it as commands do."""
    if "world" in str(document["format"]):
        path.write_text(tomli_w.dumps(document))
        read_scene(path)
        return
    robot = parse_robot(document, path)
    read_model(robot)
    if robot.document.get("leg"):
        LocomotionController.of(robot)


def refused(path: Path, document: Any, way: Way) -> None:
    """The file of a document is refused with one line that names the entry."""
    with pytest.raises(RobotError) as caught:
        opened(path, document)
    said = str(caught.value)
    assert "\n" not in said
    assert len(said) < 500
    (*_, name) = (str(key) for key in way if isinstance(key, str) and key != "value")
    assert name in said, way


@pytest.mark.parametrize("robot", ["marvin", "pendulum"])
@pytest.mark.parametrize("bad", NOWHERE, ids=["nan", "huge", "-huge", "text", "list"])
def test_robot_files(robot: str, bad: Any, tmp_path: Path) -> None:
    document = tomllib.loads((ROBOTS / f"{robot}.toml").read_text())
    ways = [way for way in numbers(document) if way[0] not in ("servo", "leg") or way[1] == 0]
    assert len(ways) > 30
    for way in ways:
        refused(tmp_path / "bad.toml", with_other(document, way, bad), way)


@pytest.mark.parametrize("bad", NOWHERE, ids=["nan", "huge", "-huge", "text", "list"])
def test_effects(bad: Any, tmp_path: Path) -> None:
    document = tomllib.loads((ROBOTS / "marvin.toml").read_text())
    for effect in catalogue().values():
        for parameter in effect.parameters:
            entry = {"value": bad, "source": "assumed"}
            document["effect"] = [{"name": effect.name, "parameters": {parameter.name: entry}}]
            refused(tmp_path / "bad.toml", document, (parameter.name,))


@pytest.mark.parametrize("bad", NOWHERE, ids=["nan", "huge", "-huge", "text", "list"])
def test_worlds(bad: Any, tmp_path: Path) -> None:
    document = tomllib.loads(WORLD)
    for way in numbers(document):
        refused(tmp_path / "bad.toml", with_other(document, way, bad), way)


@pytest.mark.parametrize(
    ("robot", "way", "value", "says"),
    [
        ("marvin", ("gait", "period_s"), -1.2, "period_s = -1.2 s is not within 0.05 to 100 s"),
        ("marvin", ("gait", "period_s"), math.inf, "period_s = inf s is not within"),
        ("marvin", ("gait", "stride_m"), 0.0, "stride_m = 0 m is not within 0.0001 to 2 m"),
        ("marvin", ("gait", "lift_m"), math.inf, "lift_m = inf m is not within"),
        ("marvin", ("gait", "cycle_s"), 5.0, "cycle_s = 5 s is not within 0 to 1 s"),
        ("marvin", ("gait", "duty_factor"), 0.3, "duty_factor = 0.3 (ratio) is not within 0.5 to"),
        ("marvin", ("gait", "neutral", "tibia"), 2.0, "tibia = 2.0 rad is not within -2.6 to 1.2"),
        ("marvin", ("rest", "femur_rad", "value"), 1.9, "femur_rad = 1.9 rad is not within -1.05"),
        ("marvin", ("leg", 5, "x_m"), -0.1, "there are 4 with x_m below 0 m, 2 above"),
        ("marvin", ("servo", 0, "direction"), 2, "direction must be 1 or -1, not 2"),
        ("marvin", ("bus", "baud_rate"), -5, "whole number of 1 to 20000000 baud, not -5"),
        ("pendulum", ("servo", 0, "zero_rad"), 9.0, "zero_rad = 9.0 rad leaves arm no range"),
        ("pendulum", ("servo", 0, "zero_rad"), 99.0, "zero_rad = 99.0 rad is not within -62.83 to"),
        (
            "pendulum",
            ("body", 0, "lower_rad", "value"),
            3.0,
            "3.0 rad is not below upper_rad = 2.6",
        ),
        (
            "pendulum",
            ("drive", "AX-12A", "gear_ratio", "value"),
            0,
            "gear_ratio = 0 (ratio) is not",
        ),
        (
            "pendulum",
            ("drive", "AX-12A", "coulomb_nm", "value"),
            -0.1,
            "-0.1 N m is not within 0.0",
        ),
        ("pendulum", ("drive", "AX-12A", "coulomb_nm", "value"), 5.0, "raise no_load_current_a"),
        (
            "pendulum",
            ("drive", "AX-12A", "coulomb_nm", "deviation"),
            -0.1,
            "deviation = -0.1 (ratio)",
        ),
        ("pendulum", ("drive", "AX-12A", "no_load_current_a", "value"), 1.6, "1.6 A is not below"),
    ],
)
def test_what_contradicts_itself_or_its_bounds(
    robot: str, way: Way, value: float, says: str, tmp_path: Path
) -> None:
    document = tomllib.loads((ROBOTS / f"{robot}.toml").read_text())
    path = tmp_path / "bad.toml"
    with pytest.raises(RobotError) as caught:
        opened(path, with_other(document, way, value))
    assert str(caught.value).startswith(f"{path}: ")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_gait_beyond_the_legs_is_not_put_down_to_its_stride(tmp_path: Path) -> None:
    document = tomllib.loads((ROBOTS / "marvin.toml").read_text())
    path = tmp_path / "bad.toml"
    path.write_text(tomli_w.dumps(with_other(document, ("gait", "neutral", "tibia"), 0.0)))
    controller = LocomotionController.of(load_robot(path))
    with pytest.raises(UnreachableError, match=r"even without a stride.*neutral posture or lift_m"):
        controller.check(1.0, 1.0)
