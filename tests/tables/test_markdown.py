"""A table as Markdown says all that the table says."""

from __future__ import annotations

import pytest

from busemu.tables import load_table, models, table_markdown


@pytest.mark.parametrize("model", models())
def test_every_register_is_in_a_row_of_equal_width(model: str) -> None:
    table, text = load_table(model), table_markdown(load_table(model))
    assert text.startswith(f"# {model}\n")
    assert text.endswith("|\n")
    for register in table.registers:
        if not register.name.startswith("indirect_"):
            assert f"| {register.address} | {register.size} | `{register.name}` |" in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {row.count("|") for row in rows} <= {10, 3}
    for code, rate in table.baud_rates.items():
        assert f"| {code} | {rate} |" in text


def test_series_is_one_row_and_areas_are_apart() -> None:
    text = table_markdown(load_table("XM430-W350"))
    assert "| 168 to 222 | 2 | `indirect_address_1` to `indirect_address_28` |" in text
    assert "| 634 to 661 | 1 | `indirect_data_29` to `indirect_data_56` |" in text
    eeprom, ram = text.split("## RAM area")
    assert "`homing_offset`" in eeprom
    assert "`torque_enable`" in ram
    assert "| 98 | 1 | `bus_watchdog` | RW | 0 | 0 to 127 | 0.02 s | signed | 38 |" in ram
    assert "| fast_sync_read | firmware 45 |" in ram
