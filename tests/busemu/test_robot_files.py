"""Robot files: the two hexapods, and the loader's rules."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from busemu.assemble import assemble
from busemu.plant import ideal
from busemu.tables import Robot, RobotError, load_robot, parse_robot, robots
from busemu.timing import Profile, load_profile

HERE = Path("mine.toml")
HEXAPODS = pytest.mark.parametrize("name", ["phantomx", "marvin"])
#: leg -> yaw [rad], position [m]. Source: the thesis, with yaw = atan2(y, x) for Marvin.
LEGS = {
    "phantomx": [
        (3 * math.pi / 4, -0.0605, 0.1206),
        (math.pi / 4, 0.0605, 0.1206),
        (5 * math.pi / 4, -0.0605, -0.1206),
        (7 * math.pi / 4, 0.0605, -0.1206),
        (math.pi, -0.1005, 0.0),
        (0.0, 0.1005, 0.0),
    ],
    "marvin": [
        (2 * math.pi / 3, -0.028, 0.0485),
        (math.pi / 3, 0.028, 0.0485),
        (4 * math.pi / 3, -0.028, -0.0485),
        (5 * math.pi / 3, 0.028, -0.0485),
        (math.pi, -0.056, 0.0),
        (0.0, 0.056, 0.0),
    ],
}


def test_two_hexapods_ship() -> None:
    assert {"marvin", "phantomx"} <= set(robots())


@HEXAPODS
def test_hexapod_has_18_servos_one_a_joint(name: str) -> None:
    robot = load_robot(name)
    assert sorted(robot.by_id) == list(range(1, 19))
    parts = ("coxa", "femur", "tibia")
    assert set(robot.by_joint) == {f"leg{leg}.{part}" for leg in range(1, 7) for part in parts}
    model = {"phantomx": "AX-12A", "marvin": "XL-320"}[name]
    assert {servo.model for servo in robot.servos} == {model}
    assert robot.protocol == {"phantomx": 1.0, "marvin": 2.0}[name]
    assert robot.baud_rate == 1_000_000
    assert load_profile(robot.timing).name == f"thesis-{name}"


@HEXAPODS
def test_legs_stand_and_point_where_the_thesis_says(name: str) -> None:
    legs = load_robot(name).document["leg"]
    assert len(legs) == 6
    for leg, (yaw, x, y) in zip(legs, LEGS[name], strict=True):
        assert leg["x_m"] == pytest.approx(x, abs=1e-9)
        assert leg["y_m"] == pytest.approx(y, abs=1e-9)
        assert math.remainder(leg["yaw_rad"] - yaw, math.tau) == pytest.approx(0.0, abs=1e-5)


def test_legs_of_marvin_point_away_from_its_centre() -> None:
    for leg in load_robot("marvin").document["leg"]:
        outward = math.atan2(leg["y_m"], leg["x_m"])
        assert math.remainder(leg["yaw_rad"] - outward, math.tau) == pytest.approx(0.0, abs=1e-3)


@HEXAPODS
def test_joint_and_servo_angle_are_each_others_inverse(name: str) -> None:
    for servo in load_robot(name).servos:
        assert servo.direction in (1, -1)
        for angle in (-0.7, 0.0, 1.1):
            assert servo.to_joint(servo.to_servo(angle)) == pytest.approx(angle)
        assert servo.to_servo(servo.zero_rad) == 0.0


@HEXAPODS
def test_registers_a_robot_file_sets_exist_and_are_in_range(name: str) -> None:
    robot = load_robot(name)
    for servo in robot.servos:
        table = robot.tables[servo.servo_id]
        for register, raw in servo.registers.items():
            count = table[register].decode(raw)
            assert table[register].minimum <= count <= table[register].maximum


# -- the loader's rules -------------------------------------------------------------------------


def document(**more: Any) -> dict[str, Any]:
    return {
        "format": "busemu-robot/1",
        "bus": {"protocol": 1.0, "baud_rate": 1_000_000, "servo_model": "AX-12A"},
        "servo": [{"id": 1, "joint": "a"}, {"id": 2, "joint": "b"}],
        **more,
    }


def test_smallest_robot_file_is_in_order() -> None:
    robot = parse_robot(document(), HERE)
    assert robot.name == "mine"
    assert robot.timing == "ideal"
    assert [servo.joint for servo in robot.servos] == ["a", "b"]
    assert load_robot  # by path below


BUS = document()["bus"]


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"format": "busemu-robot/9"}, ["format"]),
        ({"bus": {}}, ["[bus]", "protocol"]),
        ({"bus": {"protocol": 1.0}}, ["[bus]", "baud_rate"]),
        ({"bus": {**BUS, "protocol": 3.0}}, ["[bus]", "protocol", "3.0"]),
        ({"bus": {**BUS, "baud_rate": "fast"}}, ["[bus]", "baud_rate", "fast"]),
        ({"bus": {**BUS, "baud_rate": -1}}, ["[bus]", "baud_rate", "-1"]),
        ({"bus": 5}, ["[bus]"]),
        ({"servo": []}, ["[[servo]]"]),
        ({"servo": [{"id": 1, "joint": "a"}] * 2}, ["servo id 1", "twice"]),
        ({"servo": [{"id": 1, "joint": "a"}, {"id": 2, "joint": "a"}]}, ["joint a", "twice"]),
        ({"servo": [{"id": 1}]}, ["id 1", "needs joint"]),
        ({"servo": [{"id": 1, "joint": "a", "colour": 1}]}, ["id 1", "unknown key colour"]),
        ({"servo": [{"id": 254, "joint": "a"}]}, ["id 254", "0 to 253"]),
        ({"servo": [{"id": "1", "joint": "a"}]}, ["id 1", "whole number"]),
        ({"servo": [{"id": 1, "joint": "a", "direction": 2}]}, ["id 1", "direction"]),
        ({"servo": [{"id": 1, "joint": "a", "zero_rad": "x"}]}, ["id 1", "zero_rad"]),
        ({"servo": [{"id": 1, "joint": "a", "model": "AX-99"}]}, ["id 1", "AX-99", "AX-12A"]),
        ({"servo": [{"id": 1, "joint": "a", "model": "XL-320"}]}, ["id 1", "XL-320", "Protocol"]),
        (
            {"servo": [{"id": 1, "joint": "a", "registers": {"x": 1}}]},
            ["id 1", "no register 'x'"],
        ),
        (
            {"servo": [{"id": 1, "joint": "a", "registers": {"max_torque": 2000}}]},
            ["id 1", "max_torque", "2000"],
        ),
        (
            {"servo": [{"id": 1, "joint": "a", "registers": {"max_torque": "much"}}]},
            ["id 1", "max_torque", "much"],
        ),
        ({"servo": {"id": 1}}, ["[[servo]]"]),
    ],
)
def test_bad_robot_file_is_refused_with_file_entry_and_rule(
    change: dict[str, Any], parts: list[str]
) -> None:
    with pytest.raises(RobotError) as caught:
        parse_robot(document(**change), HERE)
    message = str(caught.value)
    assert "\n" not in message
    for part in ["mine.toml", *parts]:
        assert part in message


def test_servo_model_is_needed_somewhere() -> None:
    bus = {"protocol": 1.0, "baud_rate": 1_000_000}
    with pytest.raises(RobotError, match=r"mine.toml.*id 1.*servo_model"):
        parse_robot(document(bus=bus), HERE)


def test_baud_rate_that_its_servos_do_not_know_is_refused() -> None:
    robot = parse_robot(document(bus={**BUS, "baud_rate": 1234}), HERE)
    with pytest.raises(RobotError, match=r"mine.toml.*baud_rate.*1234.*1000000"):
        assemble(robot, ideal(robot), Profile("ideal"))


def test_robot_file_is_found_by_path_and_missing_or_broken_ones_are_refused(
    tmp_path: Path,
) -> None:
    path = tmp_path / "own.toml"
    path.write_text(
        'format = "busemu-robot/1"\n[bus]\nprotocol = 2.0\nbaud_rate = 57600\n'
        'servo_model = "XL-320"\n[[servo]]\nid = 4\njoint = "arm"\n',
        "utf-8",
    )
    assert load_robot(path).by_joint["arm"].servo_id == 4
    with pytest.raises(RobotError, match=r"none.toml: cannot be read"):
        load_robot(tmp_path / "none.toml")
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(RobotError, match=r"own.toml: not a TOML file"):
        load_robot(path)
    with pytest.raises(RobotError, match=r"no robot named 'r2d2'.*marvin.*phantomx"):
        load_robot("r2d2")


def test_servos_of_a_model_need_no_file(tmp_path: Path) -> None:
    robot = load_robot("XM430-W350:1-3,7")
    assert (robot.name, robot.protocol, robot.baud_rate) == ("XM430-W350", 2.0, 57_600)
    assert [servo.joint for servo in robot.servos] == ["servo1", "servo2", "servo3", "servo7"]
    assert not robot.has_bodies
    assert load_robot("MX-28(2.0):5@3000000").baud_rate == 3_000_000
    assert load_robot("AX-12A:1").baud_rate == 1_000_000
    mine = tmp_path / "mine.toml"
    mine.write_text('extends = "AX-12A"\nmodel = "Mine"\nmodel_number = 4242\n', "utf-8")
    (servo,) = assemble(
        robot := load_robot(f"{mine}:9"), ideal(robot), load_profile("ideal")
    ).servos
    assert (robot.name, servo.servo_id) == ("Mine", 9)
    assert servo.memory["model_number"] == 4242


LOOKED_AT = """
model = "Mine"
model_number = 1
protocol = 1.0
baud_rates = { 1 = 1000000 }
register = [ { name = "id", address = 3, size = 1, area = "EEPROM", initial = 1 } ]
"""


def of_mine(folder: Path, text: str) -> Robot:
    """A robot of one servo, whose table is the text."""
    mine = folder / "mine.toml"
    mine.write_text(text, "utf-8")
    bus = {"protocol": 1.0, "baud_rate": 1_000_000, "servo_model": str(mine)}
    servo = [{"id": 1, "joint": "a"}]
    return parse_robot({"format": "busemu-robot/1", "bus": bus, "servo": servo}, HERE)


def test_table_that_lacks_what_a_servo_needs_is_refused(tmp_path: Path) -> None:
    text = 'extends = "AX-12A"\nmodel = "Mine"\nmodel_number = 1\nremove = ["baud_rate"]\n'
    with pytest.raises(RobotError, match=r"mine.toml: .* needs these registers.*: baud_rate"):
        of_mine(tmp_path, text)


def test_table_without_a_drive_can_be_looked_at_and_not_served(tmp_path: Path) -> None:
    robot = of_mine(tmp_path, LOOKED_AT)
    assert load_robot(f"{tmp_path / 'mine.toml'}:1").baud_rate == 1_000_000
    with pytest.raises(RobotError, match=r"mine.toml has no \[drive\].* give it one"):
        assemble(robot, ideal(robot), load_profile("ideal"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("XM999:1", "no control table for servo model 'XM999'"),
        ("AX-12A:", "IDs are written as 1-3,7, not ''"),
        ("AX-12A:3-1", "IDs are written as"),
        ("AX-12A:1,1", "servo id 1 is there twice"),
        ("AX-12A:254", "from 0 to 253"),
        ("AX-12A:1@0", "baud_rate"),
        ("nowhere.toml:1", "nowhere.toml: cannot be read"),
    ],
)
def test_servos_without_a_file_that_cannot_be_are_refused(words: str, said: str) -> None:
    with pytest.raises(RobotError) as caught:
        load_robot(words)
    assert words in str(caught.value)
    assert said in str(caught.value)
