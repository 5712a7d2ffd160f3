"""Packets in words: what bytes on the bus say, and what is wrong with them.

    explainer = Explainer(tables=Tables(default=load_table("XL-320")))
    for explanation in explainer.explain(bytes.fromhex("FF FF FD 00 01 03 00 01 19 4E")):
        print(explanation.summary, explanation.faults)

`split` finds where packets begin and end, `check` why a check value is wrong, `parameters` and
`registers` what a packet asks or says, `explainer` puts it together, `text` lays it out.
"""

from .explainer import COLLIDED, Explainer, Explanation
from .parameters import Field, instruction_name
from .registers import Tables, Value, value_text
from .text import Line, brief, long

__all__ = [
    "COLLIDED",
    "Explainer",
    "Explanation",
    "Field",
    "Line",
    "Tables",
    "Value",
    "brief",
    "instruction_name",
    "long",
    "value_text",
]
