"""A diagnoser for tests: it tries to read what it is told to, then answers that all is well."""

from __future__ import annotations

import json
import os
import signal
import socket
import sys
from pathlib import Path

PLANS = [
    {"motion": name, "arguments": {"duration_s": 2.0, "amplitude_rad": 0.5}, "registers": {}}
    for name in ("dither", "hold", "steps")
]


def pried(word: str) -> str:
    """What comes of a try: ``read``, or the error's name."""
    try:
        if word.startswith("connect:"):
            with socket.create_connection(("127.0.0.1", int(word[8:])), timeout=5):
                return "read"
        Path(word).read_bytes()
    except OSError as error:
        return type(error).__name__
    return "read"


def told_apart(recordings: list[Path]) -> bool:
    """Whether the proposed experiment, and no other, is among the recordings."""
    return any(path.name.startswith("next-dither") for path in recordings)


def main() -> None:
    stage, out, *words = sys.argv[1:]
    if "killed" in words:
        os.kill(os.getpid(), signal.SIGKILL)
    if "fail" in words:
        raise SystemExit("there is nothing to be seen")
    (out_folder := Path(out)).joinpath("pried.json").write_text(
        json.dumps(
            {
                "tried": {word: pried(word) for word in words},
                "staged": sorted(str(p.relative_to(stage)) for p in Path(stage).rglob("*")),
                "environment": dict(os.environ),
                "arguments": sys.argv,
            }
        )
    )
    diagnosis = {"verdict": "consistent", "causes": [], "fit": {"held_out": False}}
    if "ambiguous" in words:
        name = told_apart(sorted(Path(stage).glob("recordings/next-*")))
        rivals = [] if name else [{"effect": "punch", "probability": 0.4}]
        cause = {"effect": "transport_delay", "probability": 0.6, "parameters": {}}
        diagnosis["causes"] = [{**cause, "indistinguishable_from": rivals}]
        diagnosis["verdict"] = "explained"
        proposed, *others = PLANS
        diagnosis["next_experiment"] = [{"experiment": "dither", "arguments": proposed}]
        (out_folder / "menu.json").write_text(json.dumps(others))
    (out_folder / "diagnosis.json").write_text(json.dumps(diagnosis))


main()
