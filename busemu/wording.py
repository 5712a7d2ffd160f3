"""Numbers in words."""

from __future__ import annotations


def amount(count: int, one: str, many: str = "") -> str:
    """``1 reply lost``, ``2 replies lost``; ``many`` is by default ``one`` with an s behind it."""
    return f"{count} {one if count == 1 else many or one + 's'}"
