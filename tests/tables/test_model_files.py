"""Addresses and sizes against the ``.model`` files that the official SDK's wheel brings.

Known oddities of those files: none for AX and MX with Protocol 1.0; ``mx_28.model`` is of the
Protocol 2.0 firmware; the units of ``xl320.model`` are wrong; the X330 files without ``fw52`` put
the indirect data at 224, where the e-manual and the ``fw52`` files have 208.
"""

from __future__ import annotations

import re
from pathlib import Path

import dynamixel_easy_sdk
import pytest

from busemu.tables import ControlTable, load_table, models

FOLDER = Path(dynamixel_easy_sdk.__file__).with_name("control_table")
WITHOUT_FILE = {"AX-12A", "AX-12W", "AX-18A", "MX-12W", "MX-28", "MX-64", "MX-106", "STS3215"}
#: Names that differ beyond spaces and capitals. "Read" and "Write" are places in the series.
NAMES = {
    "secondary(shadow)_id": "secondary_id",
    "secondary_id": "secondary_id",
    "registered": "registered_instruction",
    "present_speed": "present_speed",
}
PLACES = {"Indirect Address Write", "Indirect Address Read", "Indirect Data Write",
          "Indirect Data Read"}  # fmt: skip


def file_of(model: str) -> Path:
    stem = model.lower().replace("(2.0)", "").replace("xl-320", "xl320").replace("-", "_")
    newest = FOLDER / f"{stem}_fw52.model"
    return newest if newest.is_file() else FOLDER / f"{stem}.model"


def sections(path: Path) -> dict[str, list[list[str]]]:
    found: dict[str, list[list[str]]] = {}
    rows: list[list[str]] = []
    for line in path.read_text("utf-8").splitlines():
        if heading := re.fullmatch(r"\[(.+)\]", line.strip()):
            rows = found.setdefault(heading[1], [])
        elif line.strip():
            rows.append(line.strip().split("\t"))
    return found


def register_name(name: str) -> str:
    plain = name.strip().lower().replace(" ", "_")
    return NAMES.get(plain, plain)


def disagreements(table: ControlTable, rows: list[list[str]]) -> tuple[int, list[str]]:
    """How many rows could be compared, and what does not agree."""
    compared, wrong = 0, []
    at = {register.address: register for register in table.registers}
    for address, size, name in rows:
        if name in PLACES:
            register = at.get(int(address))
            kind = "indirect_address_" if "Address" in name else "indirect_data_"
            if register is None or not register.name.startswith(kind):
                wrong.append(f"{name}: nothing of the kind at {address}")
        elif register_name(name) in table:
            register = table[register_name(name)]
        else:
            continue
        compared += 1
        if register is not None and (register.address, register.size) != (int(address), int(size)):
            wrong.append(
                f"{name}: {address}, {size} there; {register.address}, {register.size} here"
            )
    return compared, wrong


@pytest.mark.parametrize("model", sorted(set(models()) - WITHOUT_FILE))
def test_addresses_and_sizes_are_those_of_the_model_file(model: str) -> None:
    table, path = load_table(model), file_of(model)
    parts = sections(path)
    rows = [row for row in parts["control table"] if row[0].isdecimal()]
    compared, wrong = disagreements(table, rows)
    assert wrong == []
    names = {register_name(name) for _, _, name in rows if name not in PLACES}
    missing = {name for name in names if name not in table}
    assert missing <= {"protocol_version"}, (path.name, missing)
    assert compared >= 30


@pytest.mark.parametrize("model", sorted(set(models()) - WITHOUT_FILE - {"XL-320"}))
def test_zero_and_velocity_unit_are_those_of_the_model_file(model: str) -> None:
    table, parts = load_table(model), sections(file_of(model))
    kind = {row[0]: float(row[1]) for row in parts["type info"] if row[0] != "name"}
    assert table["goal_position"].to_si(int(kind["value_of_zero_radian_position"])) == 0.0
    assert table["goal_position"].to_si(int(kind["value_of_max_radian_position"])) == pytest.approx(
        kind["max_radian"], abs=2e-3
    )
    units = {row[0]: row for row in parts["unit info"]}
    unit = float(units["Goal Velocity"][1])
    assert table["goal_velocity"].si_scale == pytest.approx(unit, rel=1e-3)
    for name, row in units.items():
        if register_name(name) in table:
            assert table[register_name(name)].encoding == row[3], name


def test_model_numbers_are_those_of_the_sdk() -> None:
    listed = dict(
        line.split("\t")
        for line in (FOLDER / "dynamixel.model").read_text("utf-8").splitlines()[1:]
    )
    for model in sorted(set(models()) - WITHOUT_FILE):
        name = listed[str(load_table(model).model_number)]
        assert name == file_of(model).name.replace("_fw52", ""), model


def test_comparison_notices_a_wrong_address_and_a_wrong_size() -> None:
    table = load_table("XM430-W350")
    rows = [["117", "4", "Goal Position"], ["104", "2", "Goal Velocity"], ["500", "2",
            "Indirect Address Read"], ["116", "4", "Goal Position"]]  # fmt: skip
    compared, wrong = disagreements(table, rows)
    assert compared == 4
    assert len(wrong) == 3
