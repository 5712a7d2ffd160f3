"""What is published before a case is diagnosed: hashes of the keys, and who diagnoses."""

from __future__ import annotations

import hashlib
import json
import subprocess
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench.blind import read_public
from bench.files import write_json

from . import confined
from .errors import ProofError
from .processes import ROOT

FORMAT = "busemu-published/1"
FILE = "published.json"
#: packages that a diagnosis is made of; what writes the cases and what scores is not among them
DIAGNOSER = ("busemu", "sim", "bench")
NOT_DIAGNOSER = (Path("bench/blind"), Path("bench/proof"), Path("bench/proof_commands.py"))


def sources() -> str:
    """A hash of the diagnoser's sources as they are now."""
    total = hashlib.sha256()
    for package in DIAGNOSER:
        for path in sorted((ROOT / package).rglob("*")):
            short = path.relative_to(ROOT)
            if path.suffix not in (".py", ".toml"):
                continue
            if not any(short.is_relative_to(other) for other in NOT_DIAGNOSER):
                total.update(f"{short}\n".encode() + path.read_bytes())
    return total.hexdigest()


@cache
def commit() -> str:
    """The commit of the sources, with ``-dirty`` where they differ from it; else the version."""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return f"version {version('busemu')}"
    return found.stdout.strip()


def publish(
    folder: Path, cases: list[str], plan: str, generator: str, *, left: bool = True
) -> dict[str, Any]:
    """Write ``published.json`` before anything is diagnosed, or check that it still holds.

    ``left``: cases are still to be diagnosed, so that the diagnoser must be the same. Raises
    :class:`ProofError` where the cases or the diagnoser are others than those published.
    """
    keys = {}
    for name in cases:
        public = read_public(folder / "cases" / name)
        keys[name] = {field: public[field] for field in ("key_sha256", "truth_sha256")}
    path = folder / FILE
    if path.exists():
        told: dict[str, Any] = json.loads(path.read_text("utf-8"))
        if told["plan_sha256"] != plan:
            raise ProofError(f"{path}: is of another seed or another number of cases: use --out")
        if told["cases"] != keys:
            raise ProofError(f"{path}: the cases are not those that were published: use --out")
        if left and told["diagnoser"]["sources_sha256"] != sources():
            raise ProofError(
                f"{path}: the diagnoser has changed since it was published ({commit()} now, "
                f"{told['diagnoser']['commit']} then): go back to it, or use --out"
            )
        return told
    told = {
        "format": FORMAT,
        "plan_sha256": plan,
        "generator": generator,
        "diagnoser": {"commit": commit(), "sources_sha256": sources()},
        "confinement": f"Landlock {confined.version()}" if confined.version() else "none",
        "cases": keys,
    }
    write_json(path, told)
    return told
