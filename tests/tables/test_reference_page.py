"""The reference page names every key that a table may have, and its example works."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

from busemu.assemble import assemble
from busemu.plant import ideal
from busemu.tables import Register, load_robot, load_table, models, parse_table
from busemu.timing import load_profile

PAGE = (Path(__file__).parents[2] / "docs/reference/tables.md").read_text("utf-8")
NAMED = set(re.findall(r"`([a-z_]+)`", PAGE))


def test_every_key_of_a_register_is_named() -> None:
    keys = {field.name for field in dataclasses.fields(Register)} - {"minimum", "maximum"}
    assert keys | {"range", "count", "first", "initial_step"} <= NAMED


def test_every_key_of_every_drive_is_named() -> None:
    for model in models():
        assert set(load_table(model).drive) <= NAMED, model


(EXAMPLE,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)


def test_example_can_be_served(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(EXAMPLE, "utf-8")
    robot = load_robot(f"{tmp_path / 'mine.toml'}:1-3")
    bus = assemble(robot, ideal(robot), load_profile("ideal"))
    bus.receive(bytes.fromhex("FF FF FD 00 01 03 00 01 19 4E"), 0.0)
    replied = [data for k in range(1, 100) for data in bus.poll(k * 0.001)]
    assert replied


def test_example_is_a_table() -> None:
    table = parse_table(tomllib.loads(EXAMPLE), Path("mine.toml"))
    assert table["velocity_limit"].initial == 80
    assert "bus_watchdog" not in table


def test_front_page_counts_the_models() -> None:
    front = (Path(__file__).parents[2] / "README.md").read_text("utf-8")
    assert f"a control table; {len(models())} models come along" in front
