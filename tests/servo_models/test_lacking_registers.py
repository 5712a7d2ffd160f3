"""A table that lacks registers is refused at once, or its servo does without them."""

from __future__ import annotations

from pathlib import Path

import pytest
from model_bench import OneServo

from busemu.protocol import Instruction
from busemu.servo.status import ALARM_NAMES
from busemu.tables import TableError, load_table
from busemu.tables.shape import ALARMS

#: A model of every kind of drive there is.
MODELS = ("AX-12A", "MX-64", "XL-320", "STS3215", "XL430-W250", "XM430-W350")


def live(servo: OneServo) -> None:
    """Write each register that can be written, to the ends of its range, and use every mode."""
    table = servo.table
    for register in table.registers:
        if not register.writable or register.name in ("id", "baud_rate"):
            continue
        for count in {register.minimum, register.maximum, *register.allowed}:
            servo.write("torque_enable", 0)
            servo.write(register.name, count)
            servo.write("torque_enable", 1)
            for name in ("goal_position", "goal_velocity", "goal_current", "bus_watchdog"):
                if name in table:
                    servo.write(name, 1)
            servo.sleep(0.05)
            servo.servo.read(0, table.size)
            servo.servo.return_delay_s  # noqa: B018
        servo.write(register.name, register.decode(register.initial or 0))
    servo.state(duty=1.0, voltage_v=30.0, temperature_c=200.0)
    servo.sleep(2.0)
    for instruction, parameters in (
        (Instruction.PING, b""),
        (Instruction.CLEAR, b"\x01DXL\x22"),
        (Instruction.CONTROL_TABLE_BACKUP, b"\x01CTRL"),
        (Instruction.FACTORY_RESET, b"\xff"),
        (Instruction.FACTORY_RESET, b""),
        (Instruction.REBOOT, b""),
    ):
        servo.instruct(instruction, parameters)
        servo.sleep(0.5)


@pytest.mark.parametrize("model", MODELS)
def test_each_register_is_asked_for_or_not_missed(model: str, tmp_path: Path) -> None:
    done_without = []
    for register in load_table(model).registers:
        if register.name.startswith("indirect_"):
            continue
        path = tmp_path / f"{register.name}.toml"
        path.write_text(
            f'extends = "{model}"\nmodel = "M"\nmodel_number = 1\nremove = ["{register.name}"]\n'
        )
        try:
            load_table(str(path))
        except TableError as error:
            assert register.name in str(error)  # noqa: PT017
            continue
        live(OneServo(str(path)))
        done_without.append(register.name)
    assert "led" in done_without or model == "STS3215"
    assert "present_position" not in done_without


def test_alarms_that_a_table_may_name_are_those_a_servo_has() -> None:
    assert set(ALARMS) == set(ALARM_NAMES)
