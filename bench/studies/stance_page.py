"""``index.html`` of the stance study: the question, what was hidden, and what was said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

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
            f"{one['value']:.3g} ({one['ci95'][0]:.3g} to {one['ci95'][1]:.3g}) {one['unit']}"
            for one in cause["parameters"].values()
            if one["value"] is not None and None not in one["ci95"]
        ]
        kinds = sorted({joint.rpartition(".")[2] for joint in cause["scope"]})
        rivals = sorted({rival["effect"] for rival in cause["indistinguishable_from"]})
        line = f"{cause['effect']} ({', '.join(kinds)}) {', '.join(sizes)}, "
        line += f"probability {cause['probability']:.2f}"
        lines.append(line + (f"; or {', '.join(rivals)}" if rivals else ""))
    return lines


def proposed(diagnosis: Mapping[str, Any]) -> list[str]:
    """A line for each experiment that would tell a cause from a rival."""
    return [
        f"{one['experiment']} with {told}, power {one['power']:.2f}, for "
        f"{' or '.join(one['separates'])}"
        for one in diagnosis["next_experiment"]
        for told in [", ".join(f"{k} = {v}" for k, v in one["arguments"].items())]
    ]
