"""``python -m bench.proof.writing FOLDER``: write cases; standard input has them and the secret.

A case that cannot be had in any of its attempts leaves ``NAME.not-had`` with the reasons.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from bench.blind import write_case
from bench.files import write_json

from .confined import end_with
from .plan import Planned, attempts

NOT_HAD = ".not-had"


def is_there(folder: Path, name: str) -> bool:
    """Whether a case was written, or is known not to be had."""
    return (folder / name).exists() or (folder / f"{name}{NOT_HAD}").exists()


def write_planned(folder: Path, planned: Planned, secret: str) -> None:
    """Write a case unless it is there."""
    if is_there(folder, planned.name):
        return
    reasons = []
    for seed, asked in attempts(planned):
        try:
            write_case(folder / planned.name, seed, secret, asked)
        except ValueError as error:
            reasons.append(str(error))
        else:
            return
    write_json(folder / f"{planned.name}{NOT_HAD}", {**planned.document(), "reasons": reasons})


def main() -> None:
    """Write the cases that standard input lists, one after another."""
    told = json.load(sys.stdin)
    end_with(told["parent"])
    for document in told["cases"]:
        write_planned(Path(sys.argv[1]), Planned.of(document), told["secret"])


if __name__ == "__main__":
    main()
