"""Indirect addresses read and write through, in both blocks, with the rules of where they lead."""

from __future__ import annotations

import pytest
from model_bench import OneServo

from busemu.protocol import Instruction
from busemu.servo import Refusal

BLOCKS = [("XM430-W350", 1), ("XM430-W350", 29), ("XL330-M288", 1), ("MX-28(2.0)", 40)]


def lead(servo: OneServo, first: int, *addresses: int) -> int:
    """Point indirect data from number ``first`` on to ``addresses``; the first data's address."""
    for offset, address in enumerate(addresses):
        servo.set(**{f"indirect_address_{first + offset}": address})
    return servo.table[f"indirect_data_{first}"].address


@pytest.mark.parametrize(("model", "first"), BLOCKS)
def test_reads_go_through_in_the_order_of_the_addresses(model: str, first: int) -> None:
    servo = OneServo(model, at_count=0x123)
    data = lead(servo, first, 132, 133, 134, 135, 146, 132)
    servo.state(temperature_c=33.0)
    refusal, got = servo.servo.read(data, 6)
    assert refusal is None
    assert got == b"\x23\x01\x00\x00\x21\x23"


@pytest.mark.parametrize(("model", "first"), BLOCKS)
def test_writes_go_through_and_act(model: str, first: int) -> None:
    servo = OneServo(model)
    data = lead(servo, first, 65, 64, 116, 117, 118, 119)
    assert servo.write_bytes(data, b"\x01\x01\x00\x0c\x00\x00") is None
    assert (servo.get("led"), servo.get("torque_enable")) == (1, 1)
    assert servo.get("goal_position") == 3072
    assert servo.command.torque_enable
    assert servo.command.goal_position_rad == pytest.approx(1.5708, abs=1e-4)
    assert servo.get(f"indirect_data_{first + 3}") == 0x0C


def test_indirect_data_are_memory_until_they_are_pointed_elsewhere() -> None:
    servo = OneServo("XM430-W350")
    servo.set(indirect_data_1=77, indirect_data_56=78)
    assert (servo.get("indirect_data_1"), servo.get("indirect_data_56")) == (77, 78)
    servo.set(indirect_address_1=65)
    assert servo.get("indirect_data_1") == 0
    servo.set(indirect_address_1=224)
    assert servo.get("indirect_data_1") == 77


@pytest.mark.parametrize(
    ("target", "value", "refusal"),
    [
        (65, 2, Refusal.RANGE),
        (132, 0, Refusal.ACCESS),
        (66, 0, Refusal.ACCESS),
    ],
)
def test_access_and_range_are_those_of_the_register_reached(
    target: int, value: int, refusal: Refusal
) -> None:
    servo = OneServo("XM430-W350")
    data = lead(servo, 1, 64, target)
    assert servo.write_bytes(data, bytes([1, value])) is refusal
    assert servo.get("torque_enable") == 0


def test_goal_limits_hold_through_indirect_data() -> None:
    servo = OneServo("XM430-W350")
    data = lead(servo, 1, 116, 117, 118, 119)
    assert servo.write_bytes(data, (4096).to_bytes(4, "little")) is Refusal.LIMIT
    assert servo.get("goal_position") == 2048


@pytest.mark.parametrize(("model", "last"), [("XM430-W350", 661), ("XL330-M288", 227)])
def test_only_ram_can_be_reached(model: str, last: int) -> None:
    servo = OneServo(model)
    for address in (63, 7, last + 1):
        assert servo.write("indirect_address_1", address) is Refusal.RANGE
    servo.set(indirect_address_1=last, indirect_address_2=64)


def test_registered_write_goes_through_when_it_is_carried_out() -> None:
    servo = OneServo("XM430-W350")
    data = lead(servo, 1, 65)
    status = servo.instruct(Instruction.REG_WRITE, data.to_bytes(2, "little") + b"\x01")
    assert status.error == 0
    assert (servo.get("led"), servo.get("registered_instruction")) == (0, 1)
    assert servo.instruct(Instruction.ACTION).error == 0
    assert (servo.get("led"), servo.get("registered_instruction")) == (1, 0)


def test_reboot_points_indirect_data_back_at_themselves() -> None:
    servo = OneServo("XM430-W350")
    servo.set(indirect_address_1=65, indirect_address_29=65)
    servo.reboot()
    assert servo.get("indirect_address_1") == 224
    assert servo.get("indirect_address_29") == 634
