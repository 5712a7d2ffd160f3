"""The same rows as Markdown and as plain text."""

from __future__ import annotations

from collections.abc import Sequence

#: what a cell may begin with if it is a number
_SIGNS = "+-±<>≤≥~"


def aligned(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Plain text: columns padded with spaces, a rule under the header, numbers to the right.

    Raises ``ValueError`` for a row with more or fewer cells than there are columns.
    """
    _check(columns, rows)
    right = _right(columns, rows)
    widths = [max(len(text) for text in column) for column in zip(columns, *rows, strict=True)]
    lines = [columns, ["-" * width for width in widths], *rows]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if to_right else cell.ljust(width)
            for cell, width, to_right in zip(line, widths, right, strict=True)
        ).rstrip()
        for line in lines
    )


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown: a pipe table, numbers to the right; pipes inside cells are escaped.

    Raises ``ValueError`` for a row with more or fewer cells than there are columns.
    """
    _check(columns, rows)
    rule = ["---:" if to_right else "---" for to_right in _right(columns, rows)]
    lines = [[_escaped(c) for c in columns], rule, *([_escaped(c) for c in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _check(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    for number, row in enumerate(rows, start=1):
        if len(row) != len(columns):
            raise ValueError(f"row {number} has {len(row)} cells, not {len(columns)}")


def _right(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[bool]:
    """Tell which columns hold numbers only (or a dash for none)."""
    cells = [[row[i] for row in rows] for i in range(len(columns))]
    return [
        any(map(_number, column)) and all(_number(c) or c in ("", "-") for c in column)
        for column in cells
    ]


def _number(cell: str) -> bool:
    words = cell.lstrip(_SIGNS).split()
    return bool(words) and words[0][0].isdigit() and len(words) <= 2


def _escaped(cell: str) -> str:
    return cell.replace("|", "\\|").replace("\n", " ")
