"""The keys are opened once, when all cases are answered; each is checked against its hash."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.blind import SealError, open_key, read_public
from bench.files import write_json

from .errors import ProofError

FORMAT = "busemu-opened/1"
FILE = "opened.json"


def was_opened(folder: Path) -> bool:
    """Whether keys of a proof were opened."""
    return (folder / FILE).exists()


def open_keys(
    folder: Path, names: Sequence[str], secret: str, published: dict[str, Any], answers: str
) -> dict[str, dict[str, Any]]:
    """Keys by case; ``answers`` is the hash of all answers at this moment.

    Raises :class:`ProofError` where a key is not the one that was published, or an answer has
    changed since the keys were opened.
    """
    path = folder / FILE
    if path.exists():
        told = json.loads(path.read_text("utf-8"))
        if told["answers_sha256"] != answers:
            raise ProofError(f"{path}: answers have changed since the keys were opened: use --out")
    else:
        write_json(path, {"format": FORMAT, "answers_sha256": answers})
    keys = {}
    (folder / "keys").mkdir(exist_ok=True)
    for name in names:
        case = folder / "cases" / name
        try:
            public = read_public(case)
            for field in ("key_sha256", "truth_sha256"):
                if public[field] != published["cases"][name][field]:
                    raise ProofError(f"{case}: {field} is not the one that was published")
            keys[name] = open_key(case, secret)
        except (SealError, OSError) as error:
            raise ProofError(f"a key does not open: {error}") from None
        write_json(folder / "keys" / f"{name}.json", keys[name])
    return keys
