"""A diagnoser for tests: it tries to read what it is told to, then answers that all is well."""

from __future__ import annotations

import json
import os
import socket
import sys
from pathlib import Path


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


def main() -> None:
    stage, out, *words = sys.argv[1:]
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
    (out_folder / "diagnosis.json").write_text(json.dumps(diagnosis))


main()
