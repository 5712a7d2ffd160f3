"""A user adds a servo by adding one file: it may extend another, and says clearly what is wrong."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from busemu.tables import TableError, load_table, parse_table

MINE = """
extends = "XM430-W350"
model = "Mine"
model_number = 9999
source = "me"
remove = ["bus_watchdog"]
register = [
  { name = "current_limit", initial = 100, range = [0, 200] },
  { name = "extra", address = 700, size = 2, initial = 5, since_firmware = 7 },
]
[instructions]
clear = false
[drive]
stall_current_a = 1.0
"""


def write(folder: Path, text: str, name: str = "mine.toml") -> str:
    path = folder / name
    path.write_text(text, "utf-8")
    return str(path)


def test_file_that_extends_a_model_changes_adds_and_removes(tmp_path: Path) -> None:
    table, base = load_table(write(tmp_path, MINE)), load_table("XM430-W350")
    assert (table.model, table.model_number, table.source) == ("Mine", 9999, "me")
    assert table["model_number"].initial == 9999  # what a ping tells
    assert (table["current_limit"].initial, table["current_limit"].maximum) == (100, 200)
    assert table["current_limit"].address == base["current_limit"].address
    assert (table["extra"].address, table["extra"].since_firmware) == (700, 7)
    assert "bus_watchdog" not in table
    assert "bus_watchdog" in base
    assert base["current_limit"].initial == 1193
    assert not table.supports("clear")
    assert table.supports("sync_read")
    assert table.drive["stall_current_a"] == 1.0
    assert table.drive["law"] == base.drive["law"]
    assert dict(table.baud_rates) == dict(base.baud_rates)


def test_base_beside_the_file_is_found_first(tmp_path: Path) -> None:
    write(tmp_path, 'extends = "base-x"\nremove = ["led"]\n', "base-x330.toml")
    text = 'extends = "base-x330"\nmodel = "M"\nmodel_number = 1\n'
    table = load_table(write(tmp_path, text))
    assert "led" not in table
    assert "indirect_data_56" in table


def test_series_is_numbered_and_steps_through_addresses_and_initial_values() -> None:
    table = load_table("XM430-W350")
    for number in range(1, 57):
        block = (168, 224) if number <= 28 else (578, 634)
        index = number - 1 if number <= 28 else number - 29
        address, data = table[f"indirect_address_{number}"], table[f"indirect_data_{number}"]
        assert (address.address, address.size) == (block[0] + 2 * index, 2)
        assert (data.address, data.size) == (block[1] + index, 1)
        assert address.initial == data.address
    assert "indirect_address_57" not in table
    assert "indirect_data_21" not in load_table("XL330-M288")


BARE = {"extends": "AX-12A", "model": "M", "model_number": 1}
LED = {"name": "led"}
TICK = {"name": "realtime_tick", "address": 50, "size": 1, "access": "R"}


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"extends": "XM999"}, ["extends 'XM999'", "xm999.toml"]),
        ({"register": [{"name": "model_number", "initial": 2}]}, ["model_number is 1", "2"]),
        ({"extends": 7}, ["extends must be the name", "7"]),
        ({"remove": ["goal_pwm"]}, ["remove", "ax-12a.toml", "goal_pwm"]),
        ({"register": [LED, LED]}, ["'led' is there twice"]),
        ({"register": [{"name": "new", "size": 1}]}, ["'new'", "needs address"]),
        ({"register": [{"name": "new", "address": 24, "size": 1}]}, ["overlaps"]),
        ({"register": [{**LED, "colour": 1}]}, ["'led'", "unknown key colour"]),
        ({"register": [{**LED, "initial": 2}]}, ["'led'", "initial 2"]),
        ({"register": [{**LED, "count": 0}]}, ["'led'", "count"]),
        ({"register": [{**LED, "count": 10**9}]}, ["'led'", "count 1000000000", "65535"]),
        ({"register": [{**LED, "address": 65536}]}, ["'led'", "address", "65535"]),
        ({"register": [{**LED, "allowed": [1]}]}, ["'led'", "initial 0"]),
        ({"register": [{**LED, "range": [-1, 1]}]}, ["'led'", "range -1 to 1"]),
        ({"protocol": 3.0}, ["protocol", "3.0"]),
        ({"colour": "red"}, ["unknown key colour"]),
        ({"instructions": {"jump": 0}}, ["instructions", "'jump'"]),
        ({"instructions": {"ping": "yes"}}, ["instructions", "ping = 'yes'"]),
        ({"instructions": {"ping": True}}, ["instructions", "ping = True"]),
        ({"baud_rates": {"fast": 9600}}, ["baud_rates", "fast"]),
        ({"drive": {"law": "magic"}}, ["drive", "law 'magic'", "compliance"]),
        ({"drive": {"law": "pid"}}, ["drive", "missing", "p_gain_duty_per_rad"]),
        ({"drive": {"eeprom_locked_by": "key"}}, ["drive", "eeprom_locked_by", "'key'"]),
        ({"drive": {"overlod_s": 1}}, ["drive", "unknown key overlod_s", "mean overload_s?"]),
        ({"drive": {"stall_current_a": -1}}, ["drive", "stall_current_a", "more than 0", "-1"]),
        ({"drive": {"load_refresh_s": -1}}, ["drive", "load_refresh_s", "0 or more", "-1"]),
        ({"drive": {"turn_counts": 1.5}}, ["drive", "turn_counts", "whole number", "1.5"]),
        ({"drive": {"load_sign": 2}}, ["drive", "load_sign", "1 or -1", "2"]),
        ({"drive": {"wheel_mode": "pvm"}}, ["drive", "wheel_mode", '"pwm"', "'pvm'"]),
        ({"drive": {"shutdown_bits": {"heat": 2}}}, ["shutdown_bits", "overheating", "'heat'"]),
        ({"drive": {"shutdown_bits": {"overload": 9}}}, ["shutdown_bits", "0 to 7", "9"]),
        ({"drive": {"turn_counts": 4096}}, ["multi_turn_offset", "resolution_divider"]),
        ({"remove": ["present_load"]}, ["needs these registers, too: present_load"]),
        ({"remove": ["presnt_load"]}, ["'presnt_load'", "mean present_load?"]),
        ({"register": [{"name": "goal_positon", "initial": 1}]}, ["mean goal_position?"]),
        ({"register": [{**LED, "adress": 1}]}, ["unknown key adress", "mean address?"]),
        ({"register": [{**LED, "minimum": 0}]}, ["'led'", "unknown key minimum"]),
        ({"register": [{**LED, "size": 3}]}, ["'led'", "size must be 1, 2 or 4 bytes, not 3"]),
        ({"register": [TICK]}, ["realtime_tick", "1 byte", "32767", "give it more"]),
        ({"register": [{"name": "goal_position", "size": 1, "initial": 0, "range": [0, 255]}]},
         ["goal_position", "fewer bytes than present_position"]),
        ({"model_number": 65536, "remove": ["model_number"]}, ["model_number must be 0 to 65535"]),
        ({"souce": "me"}, ["unknown key souce", "mean source?"]),
    ],
)  # fmt: skip
def test_bad_file_is_refused_with_file_entry_and_rule(change: dict, parts: list[str]) -> None:
    parse_table(BARE, Path("mine.toml"))
    with pytest.raises(TableError) as caught:
        parse_table({**BARE, **change}, Path("mine.toml"))
    for part in ["mine.toml", *parts]:
        assert part in str(caught.value)


ODD = ("", "x", -1, 10**9, True, 1.5, math.nan, [], [1], ["x"], {}, {"x": 1}, [{}])
KEYS = ("model", "model_number", "protocol", "source", "register", "remove", "baud_rates", "drive",
        "instructions", "extends")  # fmt: skip
ROW_KEYS = ("name", "address", "size", "access", "area", "initial", "range", "allowed", "encoding",
            "unit", "scale", "zero", "sign_bit", "since_firmware", "count", "first",
            "initial_step", "stored")  # fmt: skip


def taken_or_refused(document: dict[str, object]) -> str:
    """Where the table is from, or why it is none; any other error fails the test."""
    try:
        return str(parse_table(document, Path("mine.toml")).path)
    except TableError as error:
        return str(error)


@pytest.mark.parametrize("odd", ODD, ids=repr)
def test_value_of_any_kind_anywhere_is_taken_or_refused_with_the_file(odd: object) -> None:
    changes: list[dict[str, object]] = [{key: odd} for key in KEYS]
    changes += [{"register": [{**LED, key: odd}]} for key in ROW_KEYS]
    changes += [{"drive": {key: odd}} for key in load_table("AX-12A").drive]
    changes += [{"instructions": {"ping": odd}}, {"baud_rates": {"1": odd}}]
    for change in changes:
        assert "mine.toml" in taken_or_refused({**BARE, **change}), change


def test_remove_without_a_base_is_refused() -> None:
    with pytest.raises(TableError, match="remove needs extends"):
        parse_table({"model": "M", "remove": ["led"]}, Path("mine.toml"))


def test_circle_of_bases_is_refused(tmp_path: Path) -> None:
    write(tmp_path, 'extends = "b"', "a.toml")
    write(tmp_path, 'extends = "a"', "b.toml")
    with pytest.raises(TableError, match=r"extends itself: a.toml -> b.toml -> a.toml"):
        load_table(str(tmp_path / "a.toml"))


def test_base_is_no_model_and_unknown_models_are_told_what_there_is(tmp_path: Path) -> None:
    for name in ("base-x", "XM431-W350"):
        with pytest.raises(TableError, match=r"no control table .* XM430-W350"):
            load_table(name)
    with pytest.raises(TableError, match="not a TOML file"):
        load_table(write(tmp_path, "model = "))


def test_document_given_to_the_loader_is_not_changed() -> None:
    document = {**BARE, "register": [{"name": "led", "initial": 1}], "remove": ["alarm_led"]}
    before = repr(document)
    parse_table(document, Path("mine.toml"))
    assert repr(document) == before
