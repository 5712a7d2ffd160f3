"""Every shipped control table keeps the rules that a servo on the bus relies on."""

from __future__ import annotations

import pytest

from busemu.tables import load_table, models

MODELS = """
AX-12A AX-12W AX-18A MX-12W MX-28 MX-64 MX-106 MX-28(2.0) MX-64(2.0) MX-106(2.0) XL-320 STS3215
XC330-M181 XC330-M288 XC330-T181 XC330-T288 XL330-M077 XL330-M288 XL430-W250 XC430-W150 XC430-W240
XM430-W210 XM430-W350 XH430-W210 XH430-W350 XH430-V210 XH430-V350
XM540-W150 XM540-W270 XH540-W150 XH540-W270 XH540-V150 XH540-V270
""".split()  # noqa: SIM905
WITH_MODES = [m for m in MODELS if m.endswith("(2.0)") or (m[0] == "X" and m != "XL-320")]
# Source: e-manual, page of each model.
NUMBERS = {
    "AX-12A": 12, "AX-12W": 300, "AX-18A": 18, "MX-12W": 360, "MX-28": 29, "MX-64": 310,
    "MX-106": 320, "XL-320": 350, "STS3215": 777,
}  # fmt: skip


def test_all_models_are_there_and_bases_are_none_of_them() -> None:
    assert set(models()) == set(MODELS)
    assert len(models()) == len(MODELS)


@pytest.mark.parametrize("model", MODELS)
def test_registers_do_not_overlap_and_start_within_what_they_accept(model: str) -> None:
    table = load_table(model)
    assert table.model == model
    assert table["model_number"].initial == table.model_number
    assert table.model_number == NUMBERS.get(model, table.model_number)
    taken: dict[int, str] = {}
    for register in table.registers:
        for address in range(register.address, register.address + register.size):
            assert address not in taken, (register.name, taken[address])
            taken[address] = register.name
        if register.initial is not None:
            assert register.accepts(register.decode(register.initial)), register.name
        assert register.decode(register.encode(register.minimum)) == register.minimum
        assert register.decode(register.encode(register.maximum)) == register.maximum


@pytest.mark.parametrize("model", MODELS)
def test_eeprom_comes_before_ram_and_factory_baud_rate_is_known(model: str) -> None:
    table = load_table(model)
    torque = table["torque_enable"].address
    for register in table.registers:
        assert register.area == ("EEPROM" if register.address < torque else "RAM"), register.name
    assert table["baud_rate"].initial in table.baud_rates
    codes = table["baud_rate"]
    assert all(
        codes.accepts(code) for code in table.baud_rates if code < 250 or codes.maximum > 250
    )


@pytest.mark.parametrize("model", WITH_MODES)
def test_models_with_modes_say_so_in_two_complement_and_lock_eeprom_by_torque(model: str) -> None:
    table = load_table(model)
    assert table.protocol == 2.0
    for name in ("goal_pwm", "goal_velocity", "goal_position", "homing_offset", "present_position",
                 "present_velocity", "present_pwm"):  # fmt: skip
        assert table[name].encoding == "signed", name
    assert table["goal_position"].decode(0xFFFFFFFF) == -1
    assert table["goal_position"].to_si(2048) == 0.0
    assert table.drive["eeprom_locked_by"] == "torque_enable"
    current = "goal_current" in table
    assert current == (0 in table["operating_mode"].allowed) == ("current_limit" in table)
    assert current != ("present_load" in table)


@pytest.mark.parametrize(
    ("model", "name", "initial"),
    [
        ("XM430-W350", "velocity_limit", 200),
        ("XM430-W210", "velocity_limit", 330),
        ("XM540-W270", "current_limit", 2047),
        ("XH430-V350", "current_limit", 689),
        ("XL430-W250", "position_d_gain", 4000),
        ("XC430-W240", "position_p_gain", 700),
        ("XL330-M288", "velocity_p_gain", 180),
        ("XC330-T288", "max_voltage_limit", 140),
        ("XC330-M181", "position_p_gain", 1200),
        ("MX-28(2.0)", "position_p_gain", 850),
        ("MX-106", "p_gain", 32),
        ("MX-12W", "p_gain", 8),
        ("AX-18A", "max_torque", 983),
        ("AX-12W", "cw_compliance_slope", 64),
    ],
)
def test_differences_between_models_are_those_of_the_manual(
    model: str, name: str, initial: int
) -> None:
    assert load_table(model)[name].initial == initial


def test_currents_have_the_unit_of_the_model() -> None:
    for model, milliamperes in (("XM430-W350", 2.69), ("XH430-V210", 1.34), ("XL330-M288", 1.0),
                                ("MX-64(2.0)", 3.36), ("MX-64", 4.5)):  # fmt: skip
        name = "goal_torque" if model == "MX-64" else "present_current"
        assert load_table(model)[name].to_si(100) == pytest.approx(0.1 * milliamperes)


@pytest.mark.parametrize(
    ("model", "instruction", "firmware", "there"),
    [
        ("AX-12A", "sync_write", 24, True),
        ("AX-12A", "bulk_read", 24, False),
        ("AX-12A", "reboot", 24, False),
        ("MX-28", "bulk_read", 41, True),
        ("XL-320", "sync_read", 29, True),
        ("XL-320", "fast_sync_read", 99, False),
        ("XM430-W350", "fast_sync_read", 45, True),
        ("XM430-W350", "fast_sync_read", 44, False),
        ("XM430-W350", "clear", 42, True),
        ("XM430-W350", "clear", 41, False),
        ("XL330-M288", "fast_bulk_read", 45, False),
        ("XL330-M288", "fast_bulk_read", 46, True),
        ("MX-64(2.0)", "fast_sync_read", 99, False),
        ("MX-64(2.0)", "sync_read", 43, True),
    ],
)
def test_instructions_of_a_model_depend_on_its_firmware(
    model: str, instruction: str, firmware: int, there: bool
) -> None:
    assert load_table(model).supports(instruction, firmware) is there
