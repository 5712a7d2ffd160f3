"""What can be wrong with a proof."""

from __future__ import annotations


class ProofError(ValueError):
    """A proof that cannot go on: says the file or the case, and what to do."""
