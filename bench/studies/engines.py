"""How far two engines are apart when a robot walks as its file says, and nothing is hidden in it.

A walk on MuJoCo, replayed as every diagnosis does it: what the joints differ by over the gait's
phase is the engines' and their contacts' doing, and must not be called physics.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from bench.blind.drives import Electrics
from bench.blind.legged import Body
from bench.blind.scenes import SCENES, play
from bench.diagnosis.robot.features import Features
from bench.diagnosis.robot.replay import course
from bench.diagnosis.robot.replay import play as replay
from bench.figures.gait import LEGS
from bench.figures.style import GOAL, MEASURED, MODELLED, STANCE, START, save, styled
from bench.files import finite, write_json
from bench.motions import WalkPlan
from hal.legs import PARTS
from sim.model import read_model

from .stance_runs import recording_of

Floats = NDArray[np.float64]
Progress = Callable[[str], None]

SECONDS = 5.0
WALKS = ("marvin-walk", "phantomx-walk")
COLOURS = dict(zip(PARTS, (START, MEASURED, MODELLED), strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class Apart:
    """One robot's walk in both engines: rows as in :class:`Features`, differences [rad]."""

    robot: str
    joints: tuple[str, ...]
    features: Features
    difference_rad: Floats

    def of(self, part: str) -> NDArray[np.bool_]:
        """Rows of one kind of joint."""
        here = [k for k, joint in enumerate(self.joints) if joint.endswith(f".{part}")]
        return np.isin(self.features.joint_row, here)

    def numbers(self) -> dict[str, Any]:
        """RMS and mean [mrad] by kind of joint, in stance and swing."""
        found: dict[str, Any] = {"rms_mrad": _rms(self.difference_rad)}
        for part in PARTS:
            for phase, stands in (("stance", True), ("swing", False)):
                rows = self.difference_rad[self.of(part) & (self.features.stance == stands)]
                found[f"{part} {phase}"] = {
                    "rms_mrad": _rms(rows),
                    "mean_mrad": 1e3 * float(np.mean(rows)),
                }
        return found


def _rms(values: Floats) -> float:
    return 1e3 * float(np.sqrt(np.mean(values**2)))


def apart(name: str) -> Apart:
    """Walk in one engine and replay in the other; ``name`` is one of :data:`WALKS`."""
    scene = SCENES[name]
    plan = WalkPlan(seconds=SECONDS)
    played = play(scene, plan, Body(), Electrics())
    told = course(recording_of(scene.robot, played, "walk", 0.0), scene.robot)
    features = Features.of(told, scene.robot)
    base = read_model(scene.robot)
    angles, *_ = features.of_track(replay(base, told))
    joints = tuple(joint.name for joint in base.joints)
    return Apart(scene.robot.name, joints, features, features.position_rad - angles)


def write_study(folder: Path, say: Progress) -> list[str]:
    """Measure all walks into a folder, ``engines.json`` and ``engines.png``; what came of it."""
    folder.mkdir(parents=True, exist_ok=True)
    found = {}
    for name in WALKS:
        say(f"walking in two engines: {name}")
        found[name] = apart(name)
    numbers = {one.robot: one.numbers() for one in found.values()}
    write_json(folder / "engines.json", finite(numbers))
    save(engines_figure(found), folder / "engines.png")
    return [
        f"{robot}: joints differ by {row['rms_mrad']:.2f} mrad RMS over the gait's phase"
        for robot, row in numbers.items()
    ]


@styled
def engines_figure(found: Mapping[str, Apart]) -> Figure:
    """A row a robot, a column a leg: difference of the joints over the gait's phase."""
    figure = Figure(figsize=(13.6, 2.6 * len(found) + 0.6), layout="constrained")
    grid = figure.subplots(len(found), len(LEGS), sharex=True, sharey="row", squeeze=False)
    for row, one in enumerate(found.values()):
        features = one.features
        assert features.phase is not None
        for column, (leg, words) in enumerate(LEGS.items()):
            axes = grid[row, column]
            axes.axhline(0.0, color=GOAL, linewidth=0.7)
            if row == 0:
                axes.set_title(f"{words}\n({leg})")
            for part in PARTS:
                mine = features.joint_row == one.joints.index(f"{leg}.{part}")
                phase = (features.t_s[mine] % 1000.0) / features.phase.period_s
                axes.plot(phase, 1e3 * one.difference_rad[mine], color=COLOURS[part])
                if part == "coxa":
                    half = 0.5 / mine.sum()
                    for x in phase[features.stance[mine]]:
                        axes.axvspan(x - half, x + half, color=STANCE, linewidth=0, zorder=0)
        grid[row, 0].set_ylabel(f"{one.robot}\nMuJoCo - replay [mrad]")
    for axes in grid[-1]:
        axes.set_xlabel("phase")
        axes.set_xlim(0.0, 1.0)
    handles = [Line2D([], [], color=COLOURS[part], label=part) for part in PARTS]
    figure.legend(handles=handles, loc="outside lower right", ncols=3)
    return figure
