"""Explanations as lines of text, each piece with the name of a style.

The styles are words, not colours: `title`, `bad`, `note`, `hex`, `plain`. A terminal may colour
them; plain text marks what is wrong with an exclamation mark.
"""

from __future__ import annotations

from collections.abc import Iterator

from .explainer import Explanation

#: A line: pieces of text, each with its style.
Line = tuple[tuple[str, str], ...]

#: Bytes of hex on one line.
ROW = 8
_WIDTH = 3 * ROW - 1
_STYLE_OF = {"noise": "note", "fault": "title"}
#: How a terminal that has colours shows each style.
STYLES = {"title": "bold", "bad": "bold red", "note": "bright_black", "hex": "cyan", "plain": ""}


def long(explanation: Explanation) -> Iterator[Line]:
    """All that is known of a packet: a title, each field at its offset, and what is wrong."""
    yield ((title(explanation), "title"),)
    offset = 0
    for field in explanation.fields:
        style = "bad" if field.wrong else "hex"
        for row in range(0, len(field.data), ROW):
            text = field.data[row : row + ROW].hex(" ").upper()
            mark = "!" if field.wrong else " "
            words = field.words if row == 0 else ""
            gap = " " * (_WIDTH - len(text) + 2) if words else ""
            yield (
                (f"{mark}{offset + row:4}  ", "bad" if field.wrong else "note"),
                (text, style),
                (gap + words, "bad" if field.wrong else "plain"),
            )
        offset += len(field.data)
    yield from _remarks(explanation)


def brief(explanation: Explanation, lead: str = "") -> Iterator[Line]:
    """One line for a packet, and one for each thing that is wrong with it."""
    arrow = {"instruction": ">", "status": "<", "fault": "*"}.get(explanation.kind, " ")
    mark = "!" if explanation.bad else " "
    style = "bad" if explanation.bad else _STYLE_OF.get(explanation.kind, "plain")
    text = explanation.summary
    if explanation.kind in ("noise", "fragment"):
        data = explanation.data[:16].hex(" ").upper()
        text += f": {data}" + (" ..." if len(explanation.data) > 16 else "")
    yield ((lead, "note"), (f"{mark}{arrow} ", style), (text, style))
    for line in _remarks(explanation):
        yield ((" " * len(lead), "note"), *line)


def title(explanation: Explanation) -> str:
    """What kind of packet it is, and its summary."""
    if explanation.protocol is None:
        return explanation.summary
    if explanation.kind == "fragment":
        return f"Protocol {explanation.protocol}, {explanation.summary}"
    kind = f"{explanation.kind} packet"
    return f"{kind}, Protocol {explanation.protocol}: {explanation.summary}"


def _remarks(explanation: Explanation) -> Iterator[Line]:
    for fault in explanation.faults:
        yield (("!     wrong: ", "bad"), (fault, "bad"))
    for note in explanation.notes:
        yield (("      note: ", "note"), (note, "note"))
