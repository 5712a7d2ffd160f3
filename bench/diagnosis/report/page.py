"""The page of a diagnosis: one HTML file with everything in it."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from markupsafe import Markup

from bench.diagnosis.joint.search import HELD_OUT, NEEDED
from bench.diagnosis.result import Cause, Diagnosis

from ...files import write_text
from ...pages import template
from . import telling, words
from .inline import svg
from .pictures import motion_picture, recordings_picture, regime_picture, time_picture
from .traces import Trace, typical, worst

WORTH_A_LINE = 1.0  #: gain [nats, deflated] from which a hypothesis is listed


@dataclass(frozen=True, slots=True)
class Origin:
    """What a diagnosis was made of, for the page to say."""

    robot: str
    title: str
    fitted: tuple[str, ...]  #: names of the recordings that were fitted
    left_out: tuple[str, ...]  #: effects that were taken out of the catalogue
    seed: int
    on: date
    model: str  #: where the better model is, as a person would type it


def report_page(diagnosis: Diagnosis, traces: Sequence[Trace], origin: Origin) -> str:
    """The page as text."""
    ranking = _ranking(diagnosis)
    listed = [row for row in ranking if row["taken"] or row["deflated_nats"] >= WORTH_A_LINE]
    return template(__package__, "page.html.j2").render(
        d=diagnosis,
        origin=origin,
        words=words,
        telling=telling,
        pictures=_pictures(diagnosis, traces),
        ranking=listed,
        next_to_nothing=len(ranking) - len(listed),
        worth_a_line=WORTH_A_LINE,
        pairs=[pair for cause in diagnosis.causes for pair in _pairs(diagnosis, cause)],
        details=_details(diagnosis),
        cautions=telling.cautions(diagnosis),
        states=_states(diagnosis),
        advice=[line.replace("{model}", origin.model) for line in telling.advice(diagnosis)],
        needed=NEEDED,
        held_out_needed=HELD_OUT,
    )


def write_report(path: Path, diagnosis: Diagnosis, traces: Sequence[Trace], origin: Origin) -> None:
    """Write the page, whole or not at all. Raises ``OSError``."""
    write_text(path, report_page(diagnosis, traces, origin))


def _pictures(diagnosis: Diagnosis, traces: Sequence[Trace]) -> Mapping[str, Any]:
    floor = diagnosis.fit.noise_floor
    motions = []
    for which, trace in (("worst", worst(traces)), ("typical", typical(traces))):
        if trace is not None:
            drawn = _svg(
                motion_picture(trace, floor),
                which,
                f"Recorded and modelled motion of {trace.joint} in {trace.name}",
            )
            motions.append({"which": which, "trace": trace, "svg": drawn})
    return {
        "motions": motions,
        "regimes": _svg(
            regime_picture(traces, floor), "regimes", "Misfit before and after by part of motion"
        ),
        "time": _svg(time_picture(traces, floor), "time", "Misfit before and after over time"),
        "recordings": _svg(
            recordings_picture(traces, floor), "recordings", "Misfit before and after by recording"
        ),
    }


def _svg(figure: Any, name: str, title: str) -> Markup:
    return Markup(svg(figure, name, html.escape(title)))


def _ranking(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Confirmed hypotheses by joint, the best first, with the length of their bars [%].

    One that was fitted from several beginnings stands there once, with its best fit.
    """
    most = max([1.0, *(float(row["deflated_nats"]) for row in diagnosis.ranking)])
    ordered = sorted(
        diagnosis.ranking,
        key=lambda row: (row.get("joint", ""), len(row["with"]), -float(row["deflated_nats"])),
    )
    best: dict[tuple[str, ...], Mapping[str, Any]] = {}
    for row in ordered:
        best.setdefault((row.get("joint", ""), row["effect"], *sorted(row["with"])), row)
    return [
        dict(row)
        | {
            "bar": max(0.0, 100.0 * float(row["deflated_nats"]) / most),
            "taken": row.get(
                "named", {row["effect"], *row["with"]} <= _chosen(diagnosis, row.get("joint"))
            ),
            "enough": float(row["deflated_nats"]) >= NEEDED,
        }
        for row in best.values()
    ]


def _chosen(diagnosis: Diagnosis, joint: str | None) -> set[str]:
    """Effects that are named, of one joint if it is told."""
    return {c.effect for c in diagnosis.causes if joint is None or joint in c.scope}


def _details(diagnosis: Diagnosis) -> list[tuple[str, Mapping[str, Any]]]:
    """How it was done: for each joint, or without a name for the only one."""
    joints = diagnosis.details.get("joints")
    return list(joints.items()) if joints else [("", diagnosis.details)]


def _pairs(diagnosis: Diagnosis, cause: Cause) -> list[dict[str, Any]]:
    """A cause and each of its rivals, and what would tell them apart."""
    found = []
    for rival in cause.indistinguishable_from:
        pair = {cause.effect, rival.effect}
        told = [
            text
            for each, text in zip(
                diagnosis.next_experiment, telling.experiments(diagnosis), strict=True
            )
            if pair <= set(each.separates)
        ]
        found.append({"cause": cause, "rival": rival, "experiments": told})
    return found


def _states(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """The states that occur, and what they mean."""
    found = dict.fromkeys(
        "trade-off" if e.state.startswith("trade-off") else e.state
        for cause in diagnosis.causes
        for e in cause.parameters.values()
    )
    return [(state, words.STATES[state]) for state in found if state in words.STATES]
