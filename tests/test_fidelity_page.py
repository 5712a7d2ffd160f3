"""The fidelity page: every row says what holds it, and every test that it names is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/fidelity.md").read_text("utf-8")
HEADING = ["property", "emulated", "error", "held by", "evidence"]
ROWS = [
    [cell.strip() for cell in line[1:-1].split("|")]
    for line in PAGE.splitlines()
    if line.startswith("|") and not line.startswith("|---")
]
NAMED = sorted(set(re.findall(r"`(tests/[^`]+)`", PAGE)))


def test_every_row_has_the_five_columns() -> None:
    assert ROWS.count(HEADING) == PAGE.count("\n## ")
    assert [row for row in ROWS if len(row) != len(HEADING)] == []
    assert len(ROWS) > 60


def test_what_is_emulated_is_held_by_something() -> None:
    for name, emulated, error, held, evidence in ROWS:
        if not re.match(r"(no|only)\b", f"{emulated or error}") and "off in" not in emulated:
            assert "`" in held or evidence, name
        assert "same" not in held.split(), name


@pytest.mark.parametrize("named", NAMED)
def test_every_test_that_is_named_is_there(named: str) -> None:
    file, _, test = named.partition("::")
    assert (ROOT / file).exists()
    if test:
        assert re.search(rf"^def {test}\(", (ROOT / file).read_text("utf-8"), re.MULTILINE), test
