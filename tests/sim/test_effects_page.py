"""The reference page of the effects is that of the catalogue."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.effects import catalogue
from sim.effects.__main__ import main, page

PAGE = Path(__file__).parents[2] / "docs/reference/effects.md"


def test_the_page_is_current() -> None:
    assert PAGE.read_text("utf-8") == page(catalogue().values()), (
        "run python -m sim.effects docs/reference/effects.md"
    )


def test_every_effect_and_parameter_is_on_the_page() -> None:
    text = page(catalogue().values())
    for effect in catalogue().values():
        section = text.split(f"\n### {effect.name}\n")[1].split("\n#")[0]
        for parameter in effect.parameters:
            assert f"| `{parameter.name}` | {parameter.unit} |" in section


def test_the_command_writes_what_it_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main([])
    printed = capsys.readouterr().out
    main([str(tmp_path / "effects.md")])
    assert (tmp_path / "effects.md").read_text("utf-8") == printed
    assert [path.name for path in tmp_path.iterdir()] == ["effects.md"]
