"""The reference page names every key that a table may have, and its example works."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

from busemu.tables import Register, load_table, models, parse_table

PAGE = (Path(__file__).parents[2] / "docs/reference/tables.md").read_text("utf-8")
NAMED = set(re.findall(r"`([a-z_]+)`", PAGE))


def test_every_key_of_a_register_is_named() -> None:
    keys = {field.name for field in dataclasses.fields(Register)} - {"minimum", "maximum"}
    assert keys | {"range", "count", "first", "initial_step"} <= NAMED


def test_every_key_of_every_drive_is_named() -> None:
    for model in models():
        assert set(load_table(model).drive) <= NAMED, model


def test_example_is_a_table() -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    table = parse_table(tomllib.loads(example), Path("mine.toml"))
    assert table["velocity_limit"].initial == 80
    assert "bus_watchdog" not in table
