"""Numbers in words."""


def repeats(count: int) -> str:
    """``1 repeat``, ``5 repeats``."""
    return f"{count} repeat" + ("" if count == 1 else "s")
