"""A figure as SVG that stands in a page: it takes the page's colours, light or dark."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from types import MappingProxyType

import matplotlib as mpl
from matplotlib.figure import Figure

from bench.figures.style import GOAL, GRID, INK, styled

AFTER = "#0b6bcb"
BEFORE = "#e07b00"
EDGE = "#a5acb5"
BAND = "#e4e9f0"

#: colours of the pictures, and the page's names for them; it gives each a light and a dark value
COLOURS: Mapping[str, str] = MappingProxyType(
    {
        INK: "ink",
        GRID: "grid",
        GOAL: "goal",
        BEFORE: "before",
        AFTER: "after",
        EDGE: "edge",
        BAND: "band",
    }
)


@styled
def svg(figure: Figure, name: str, title: str) -> str:
    """The figure as an ``<svg>`` element; ``name`` keeps its ids apart from those of others.

    Text stays text. ``title`` is read out where the picture is not seen.
    """
    with mpl.rc_context({"svg.fonttype": "none"}):
        buffer = io.StringIO()
        figure.savefig(
            buffer,
            format="svg",
            transparent=True,
            metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
        )
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    text = text.replace("xlink:href", "href")
    text = re.sub(r' id="([^"]+)"', rf' id="{name}-\1"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", text)
    text = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', text)
    for colour, word in COLOURS.items():
        text = text.replace(colour, f"var(--{word})")
    text = re.sub(r"(font: [^;\"]*?)'[^;\"]*", r"\1var(--face)", text)
    return text.replace("<svg", f'<svg role="img" aria-label="{title}"', 1).strip()
