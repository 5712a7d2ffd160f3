"""A small proof for tests, with the diagnoser that pries."""

from __future__ import annotations

from pathlib import Path

from bench.blind import Asked
from bench.proof.answering import Method
from bench.proof.plan import Planned
from bench.proof.running import Proof

HERE = Path(__file__).parent
EASY = {"rig": "xl330-pendulum", "style": "position", "programme": "slow"}


def prying(*words: str) -> Method:
    """The diagnoser that tries to read what the words name."""
    return Method("prying_diagnoser", words, (HERE,))


def small_proof(folder: Path, *words: str) -> Proof:
    """A proof of nulls, which are written quickly."""
    planned = tuple(Planned(f"case-{n:04d}", 40 + n, Asked("null", **EASY)) for n in (1, 2))
    return Proof(folder, planned, 2, prying(*words))


def delayed_proof(folder: Path, *words: str) -> Proof:
    """A proof of one case with a large delay."""
    asked = Asked("single", ("transport_delay",), 8.0, "plain", **EASY)
    return Proof(folder, (Planned("case-0001", 41, asked),), 2, prying(*words))
