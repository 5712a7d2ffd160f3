"""``index.html`` of the stance study: the question, what was hidden, and what was said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from bench.diagnosis.report import words
from bench.files import write_text
from bench.pages import STYLE, template

from .stance_runs import Run

if TYPE_CHECKING:
    from .stance import Answer


def write_page(out: Path, answers: Sequence[Answer], result: Mapping[str, Any]) -> None:
    """Write the page, whole or not at all; pictures and reports are named relative to it."""
    page = template(__package__, "stance.html.j2").render(
        style=Markup(STYLE),
        result=result,
        answers=answers,
        hidden=hidden,
        named=named,
        proposed=proposed,
    )
    write_text(out / "index.html", page)


def hidden(run: Run) -> str:
    """What a run has, with its sizes."""
    sizes = []
    if run.cause.tips:
        sizes.append(f"tips {run.tips_n_m:.0f} N/m")
    if run.cause.joints:
        sizes.append(f"femurs and tibiae {run.joints_rad_nm:.2f} rad/(N m)")
    return ", ".join(sizes) or "nothing"


def named(diagnosis: Mapping[str, Any]) -> list[str]:
    """A line for each cause: name, size with its interval, probability and rivals."""
    lines = []
    for cause in diagnosis["causes"]:
        sizes = [
            f"{words.quantity(one['value'], one['unit'])} "
            f"({words.number(one['ci95'][0])} to {words.number(one['ci95'][1])})"
            for one in cause["parameters"].values()
        ]
        rivals = sorted({rival["effect"] for rival in cause["indistinguishable_from"]})
        place = f" of {words.in_few(cause['scope'])}" if cause["scope"] else ""
        line = f"{words.plain(cause['effect'])}{place}: "
        line += f"{', '.join(sizes)}, probability {cause['probability']:.2f}"
        instead = words.joined(map(words.plain, rivals), "or")
        lines.append(line + (f"; or {instead}" if rivals else ""))
    return lines


def proposed(diagnosis: Mapping[str, Any]) -> list[str]:
    """A line for each experiment that would tell a cause from a rival."""
    return [
        f"{one['experiment']} with {told}, power {one['power']:.2f}, for "
        f"{words.joined(map(words.plain, one['separates']), 'or')}"
        for one in diagnosis["next_experiment"]
        for told in [", ".join(f"{k} = {v}" for k, v in one["arguments"].items())]
    ]
