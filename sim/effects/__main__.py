"""``python -m sim.effects``: the catalogue as Markdown; with a file name, into that file."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from . import Effect, Group, Scope, catalogue

INTRODUCTION = """\
# Effects

Physics that can be switched on in a robot, beyond the base model of its file. An effect takes a
robot and gives a robot; with every parameter at its *off* value the robot that comes out is the one
that went in, to the bit. A new effect is one file in `sim/effects/`.

In a robot file, for the emulator, the experiments and the walk alike:

```toml
[[effect]]
name = "backlash"
where = ["leg1.tibia"]       # absent: everywhere
[effect.parameters]
width_rad = { value = 0.011, ci95 = [0.010, 0.012], unit = "rad", source = "walk-1, walk-2" }
```

`ci95` and `unit` may be left out; a parameter left out is off. Values beyond the bounds, unknown
names and places are refused. `busemu diagnose` writes such files.

Over the emulated bus, too, a program meets every one of them. A lost sample is there a reply that
does not come, and takes those after it in a sync read along; a position of a later instant
(`read_skew` above 0) is foretold from the speed; no register shows a shutdown of
`overload_shutdown`.

This page is made by `python -m sim.effects docs/reference/effects.md`.
"""

PLACES = {
    Scope.JOINT: "joints",
    Scope.LEG: "legs",
    Scope.BODY: "bodies, by the joint that moves them, or `trunk`",
    Scope.ROBOT: "the whole robot",
    Scope.BUS: "the bus",
}


def page(effects: Iterable[Effect]) -> str:
    """The reference page of some effects, by group. Ends with a line break."""
    known = list(effects)
    lines = [INTRODUCTION.rstrip()]
    for group in Group:
        members = [effect for effect in known if effect.group is group]
        if members:
            lines += ["", f"## {group.value[0].upper()}{group.value[1:]}"]
        for effect in members:
            lines += ["", *_section(effect)]
    return "\n".join(lines) + "\n"


def _section(effect: Effect) -> list[str]:
    lines = [
        f"### {effect.name}",
        "",
        f"`{effect.equation}`",
        "",
        f"Acts on {PLACES[effect.scope]}; enters in the {effect.enters}. Source: {effect.source}.",
        "",
        *([effect.note, ""] if effect.note else []),
        "| parameter | unit | bounds | typical | off | source |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for p in effect.parameters:
        bounds = f"{_number(p.low)} to {_number(p.high)}"
        cells = (f"`{p.name}`", p.unit, bounds, _number(p.typical), _number(p.off), p.source)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return lines


def _number(value: float) -> str:
    return "infinite" if math.isinf(value) else f"{value:.4g}"


def main(arguments: list[str]) -> None:
    """Print the page, or write it to the file named."""
    if arguments in (["-h"], ["--help"]):
        print(__doc__)
        return
    text = page(catalogue().values())
    if not arguments:
        sys.stdout.write(text)
        return
    path = Path(arguments[0])
    new = path.with_name(path.name + ".new")
    new.write_text(text, "utf-8")
    os.replace(new, path)


if __name__ == "__main__":
    main(sys.argv[1:])
