"""Servos that hang on nothing but a bus are well: supplied as their model wants it."""

from __future__ import annotations

import pytest

from bench.testing import ServoBusMaker
from busemu.plant import SUPPLY_V, ideal
from busemu.tables import load_robot, models


@pytest.mark.parametrize("model", models())
def test_servos_without_a_robot_file_raise_no_alarm_and_keep_their_torque(model: str) -> None:
    robot = load_robot(f"{model}:1-2")
    bus = ServoBusMaker(folder=lambda: robot.path)(robot.path)
    servo = bus.bus.servos[0]
    register = servo.table["torque_enable"]
    assert servo.listens(0.0)
    assert servo.write(register.address, b"\x01") is None
    bus.run(2.0)
    assert not servo.protection.alarms
    assert bus.servo(1).register("torque_enable") == 1


def test_the_supply_is_that_of_the_robot_file_else_twelve_volts_or_the_middle_of_the_limits() -> (
    None
):
    marvin = load_robot("marvin")
    told = marvin.document["supply"]["voltage_v"]["value"]
    assert ideal(marvin).sample(1).voltage_v == told
    mixed = ideal(load_robot("XM430-W350:1")).sample(1).voltage_v
    assert mixed == SUPPLY_V
    low_v, high_v = 3.5, 7.0  # XL330: e-manual
    assert ideal(load_robot("XL330-M288:1")).sample(1).voltage_v == 0.5 * (low_v + high_v)
