"""Control tables: the loader's rules, SI, and the two hexapods' tables against the e-manual."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from busemu.tables import TableError, load_table, models, parse_table

HERE = Path("mine.toml")

# name, address, size, writable, value as delivered (None: not said). Source: e-manual, AX-12A.
AX_12A = """
model_number 0 2 R 12;firmware_version 2 1 R -;id 3 1 RW 1;baud_rate 4 1 RW 1;
return_delay_time 5 1 RW 250;cw_angle_limit 6 2 RW 0;ccw_angle_limit 8 2 RW 1023;
temperature_limit 11 1 RW 70;min_voltage_limit 12 1 RW 60;max_voltage_limit 13 1 RW 140;
max_torque 14 2 RW 1023;status_return_level 16 1 RW 2;alarm_led 17 1 RW 36;shutdown 18 1 RW 36;
torque_enable 24 1 RW 0;led 25 1 RW 0;cw_compliance_margin 26 1 RW 1;
ccw_compliance_margin 27 1 RW 1;cw_compliance_slope 28 1 RW 32;ccw_compliance_slope 29 1 RW 32;
goal_position 30 2 RW -;moving_speed 32 2 RW -;torque_limit 34 2 RW -;present_position 36 2 R -;
present_speed 38 2 R -;present_load 40 2 R -;present_voltage 42 1 R -;present_temperature 43 1 R -;
registered_instruction 44 1 R 0;moving 46 1 R 0;lock 47 1 RW 0;punch 48 2 RW 32
"""
# Source: e-manual, XL-320.
XL_320 = """
model_number 0 2 R 350;firmware_version 2 1 R -;id 3 1 RW 1;baud_rate 4 1 RW 3;
return_delay_time 5 1 RW 250;cw_angle_limit 6 2 RW 0;ccw_angle_limit 8 2 RW 1023;
control_mode 11 1 RW 2;temperature_limit 12 1 RW 65;min_voltage_limit 13 1 RW 60;
max_voltage_limit 14 1 RW 90;max_torque 15 2 RW 1023;status_return_level 17 1 RW 2;
shutdown 18 1 RW 3;torque_enable 24 1 RW 0;led 25 1 RW 0;d_gain 27 1 RW 0;i_gain 28 1 RW 0;
p_gain 29 1 RW 32;goal_position 30 2 RW -;moving_speed 32 2 RW -;torque_limit 35 2 RW -;
present_position 37 2 R -;present_speed 39 2 R -;present_load 41 2 R -;present_voltage 45 1 R -;
present_temperature 46 1 R -;registered_instruction 47 1 R 0;moving 49 1 R 0;
hardware_error_status 50 1 R 0;punch 51 2 RW 32
"""


def rows(text: str) -> dict[str, tuple[int, int, str, str]]:
    found = {}
    for row in text.replace("\n", "").split(";"):
        name, address, size, access, initial = row.split()
        found[name] = (int(address), int(size), access, initial)
    return found


@pytest.mark.parametrize(("model", "text", "ram"), [("AX-12A", AX_12A, 24), ("XL-320", XL_320, 24)])
def test_table_is_that_of_the_manual(model: str, text: str, ram: int) -> None:
    table = load_table(model)
    expected = rows(text)
    assert {r.name for r in table.registers} == set(expected)
    for register in table.registers:
        address, size, access, initial = expected[register.name]
        assert (register.address, register.size, register.access) == (address, size, access)
        assert register.area == ("RAM" if address >= ram else "EEPROM")
        if initial != "-":
            assert register.initial == int(initial), register.name


@pytest.mark.parametrize(
    ("model", "rates"),
    [
        ("AX-12A", {1: 1_000_000, 3: 500_000, 16: 115_200, 34: 57_600, 103: 19_200, 207: 9600}),
        ("XL-320", {0: 9600, 1: 57_600, 2: 115_200, 3: 1_000_000}),
    ],
)
def test_baud_rates_are_those_of_the_manual(model: str, rates: dict[int, int]) -> None:
    table = load_table(model)
    assert {code: table.baud_rates[code] for code in rates} == rates


def test_every_shipped_table_parses_and_says_its_source() -> None:
    assert {"AX-12A", "XL-320"} <= set(models())
    for model in models():
        table = load_table(model)
        assert table.model == model
        assert table.source
        assert table.protocol in (1.0, 2.0)
        for name in ("model_number", "firmware_version", "id", "baud_rate", "return_delay_time"):
            assert name in table, (model, name)
        assert table["model_number"].initial == table.model_number
        assert table["baud_rate"].initial in table.baud_rates
        for register in table.registers:
            assert register.area in ("EEPROM", "RAM")
            if register.initial is not None and register.writable:
                count = register.decode(register.initial)
                assert register.minimum <= count <= register.maximum, (model, register.name)


# -- SI -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["AX-12A", "XL-320"])
def test_position_is_0_at_the_centre_and_1024_steps_make_300_degrees(model: str) -> None:
    register = load_table(model)["goal_position"]
    assert register.si_unit == "rad"
    assert register.to_si(512) == 0.0
    assert register.to_si(1023) - register.to_si(0) == pytest.approx(
        math.radians(300) * 1023 / 1024
    )
    assert register.from_si(math.radians(30)) == 512 + round(30 / 300 * 1024)


@pytest.mark.parametrize(
    ("name", "raw", "value", "unit"),
    [
        ("moving_speed", 100, 11.1 * math.pi / 30, "rad/s"),
        ("moving_speed", 1024 + 100, -11.1 * math.pi / 30, "rad/s"),
        ("present_load", 1023, 1.0, ""),
        ("present_load", 2047, -1.0, ""),
        ("torque_limit", 512, 512 / 1023, ""),
        ("min_voltage_limit", 60, 6.0, "V"),
        ("temperature_limit", 70, 70.0, "degC"),
        ("return_delay_time", 250, 500e-6, "s"),
        ("punch", 32, 32 / 1023, ""),
    ],
)
def test_raw_values_read_in_si(name: str, raw: int, value: float, unit: str) -> None:
    register = load_table("AX-12A")[name]
    assert register.to_si(raw) == pytest.approx(value, rel=1e-5)
    assert register.si_unit == unit


@pytest.mark.parametrize("model", ["AX-12A", "XL-320"])
def test_si_there_and_back_is_the_same_number(model: str) -> None:
    for register in load_table(model).registers:
        counts = {register.minimum, register.maximum, (register.minimum + register.maximum) // 2, 1}
        for count in counts:
            if register.minimum <= count <= register.maximum:
                raw = register.encode(count)
                assert register.decode(raw) == count
                assert register.from_si(register.to_si(raw)) == raw


def test_value_is_rounded_first_and_then_checked() -> None:
    register = load_table("AX-12A")["goal_position"]
    step = math.radians(300 / 1024)
    assert register.from_si(511.49 * step) == 1023
    assert register.from_si(-512.49 * step) == 0
    for steps in (511.51, -512.51):
        with pytest.raises(ValueError, match=r"goal_position: .* rad is outside \["):
            register.from_si(steps * step)


def test_sign_magnitude_has_one_bit_for_the_direction() -> None:
    register = load_table("AX-12A")["moving_speed"]
    assert [register.decode(raw) for raw in (0, 1, 1023, 1024, 1025, 2047)] == [
        0, 1, 1023, 0, -1, -1023,
    ]  # fmt: skip
    assert [register.encode(count) for count in (0, 1, -1, -1023)] == [0, 1, 1025, 2047]
    with pytest.raises(ValueError, match="does not fit"):
        register.encode(1024)


# -- the loader's rules -------------------------------------------------------------------------

ROW = {"name": "led", "address": 25, "size": 1}


def document(*rows_: dict, **more: object) -> dict:
    return {
        "model": "M",
        "model_number": 1,
        "protocol": 2.0,
        "baud_rates": {"3": 1_000_000},
        "register": list(rows_) or [ROW],
        **more,
    }


def test_document_of_the_tests_below_is_in_order() -> None:
    table = parse_table(document(), HERE)
    assert table["led"].address == 25
    assert (table["led"].minimum, table["led"].maximum) == (0, 255)


@pytest.mark.parametrize(
    ("row", "entry", "rule"),
    [
        ({**ROW, "acess": "R"}, "led", "acess"),
        ({**ROW, "size": 0}, "led", "size"),
        ({**ROW, "size": "1"}, "led", "size"),
        ({"name": "led", "size": 1}, "led", "address"),
        ({"address": 25, "size": 1}, "?", "name"),
        ({**ROW, "address": -1}, "led", "address"),
        ({**ROW, "address": "25"}, "led", "address"),
        ({**ROW, "access": "W"}, "led", "access 'W' is not one of"),
        ({**ROW, "area": "FLASH"}, "led", "area 'FLASH' is not one of"),
        ({**ROW, "unit": "furlong"}, "led", "unit 'furlong' is not one of"),
        ({**ROW, "encoding": "bcd"}, "led", "encoding 'bcd' is not one of"),
        ({**ROW, "range": [3, 1]}, "led", "range"),
        ({**ROW, "range": [0]}, "led", "range"),
        ({**ROW, "range": [0, 256]}, "led", "range"),
        ({**ROW, "initial": 256}, "led", "initial 256"),
        ({**ROW, "scale": 0.0}, "led", "scale"),
    ],
)
def test_bad_register_is_refused_with_file_register_and_rule(
    row: dict, entry: str, rule: str
) -> None:
    with pytest.raises(TableError) as caught:
        parse_table(document(row), HERE)
    message = str(caught.value)
    assert "mine.toml" in message
    assert entry in message
    assert rule in message
    assert "\n" not in message


def test_register_that_is_there_twice_or_overlaps_is_refused() -> None:
    with pytest.raises(TableError, match=r"mine.toml.*'led'.*twice"):
        parse_table(document(ROW, {**ROW, "address": 40}), HERE)
    with pytest.raises(TableError, match=r"mine.toml.*'b' overlaps 'a'"):
        parse_table(
            document(
                {"name": "a", "address": 4, "size": 4}, {"name": "b", "address": 7, "size": 1}
            ),
            HERE,
        )


@pytest.mark.parametrize("key", ["model", "model_number", "protocol", "register", "baud_rates"])
def test_table_without_a_key_it_needs_is_refused(key: str) -> None:
    lacking = document()
    del lacking[key]
    with pytest.raises(TableError, match=rf"mine.toml.*{key}"):
        parse_table(lacking, HERE)


def test_unknown_model_names_the_known_ones() -> None:
    with pytest.raises(TableError, match=r"'AX-99'.*AX-12A"):
        load_table("AX-99")


def test_table_may_be_a_file_of_the_user(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(
        'model = "OWN"\nmodel_number = 9\nprotocol = 1.0\n'
        'register = [{ name = "id", address = 3, size = 1 }]\n[baud_rates]\n1 = 1000000\n',
        "utf-8",
    )
    assert load_table(str(path)).model == "OWN"
    broken = tmp_path / "broken.toml"
    broken.write_text("model = ", "utf-8")
    with pytest.raises(TableError, match=r"broken.toml.*not a TOML file"):
        load_table(str(broken))
