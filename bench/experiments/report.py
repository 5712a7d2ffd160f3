"""What an evaluated experiment leaves behind: result.json, figure.png, and a few lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..figures.style import save
from ..figures.tables import aligned
from ..files import finite, write_json
from ..recording import Recording
from .experiment import Experiment, Result
from .noticed import noticed, told

FORMAT = "busemu-experiment/1"


def document(
    experiment: Experiment[Any], result: Result, recordings: Sequence[Recording]
) -> dict[str, Any]:
    """The content of ``result.json``; numbers that are not known are ``null``."""
    found: dict[str, Any] = finite(
        {
            "format": FORMAT,
            "experiment": experiment.name,
            "thesis_figures": experiment.figures,
            "robot": result.robot,
            "recordings": [
                {"name": recording.name, "source": recording.metadata.get("source")}
                for recording in recordings
            ],
            "numbers": result.numbers(),
            "beside_the_thesis": [
                {
                    "what": row.what,
                    "ours": row.ours,
                    "thesis": row.thesis,
                    "comparable": row.comparable,
                    "why_not": row.why_not,
                }
                for row in result.comparisons()
            ],
            "findings": list(result.findings()),
            "noticed": [one.numbers() for one in noticed(recordings)],
        }
    )
    return found


def write_report(
    experiment: Experiment[Any], result: Result, recordings: Sequence[Recording], folder: Path
) -> tuple[Path, Path]:
    """Write ``result.json`` and ``figure.png`` into a folder, each whole or not at all.

    Raises ``OSError``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    numbers, picture = folder / "result.json", folder / "figure.png"
    figure = experiment.draw(result)
    write_json(numbers, document(experiment, result, recordings))
    save(figure, picture)
    return numbers, picture


def summary(result: Result, recordings: Sequence[Recording]) -> str:
    """Findings, what was noticed, and numbers beside the thesis's with reservations below."""
    lines = [f"- {said}" for said in (*result.findings(), *told(noticed(recordings)))]
    rows = result.comparisons()
    if not rows:
        return "\n".join(lines)
    reasons = list(dict.fromkeys(row.why_not for row in rows if row.why_not))
    table = aligned(
        ("beside the thesis", "here", "thesis", "comparable"),
        [
            (
                row.what,
                row.ours,
                row.thesis,
                "yes" if row.comparable else f"no [{reasons.index(row.why_not) + 1}]",
            )
            for row in rows
        ],
    )
    notes = [f"[{number}] {reason}" for number, reason in enumerate(reasons, start=1)]
    return "\n".join([*lines, "", table, *notes])
