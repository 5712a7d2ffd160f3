"""The loop closed: a better model walks over the emulated bus as the real robot walked.

A robot of another engine, with soft tips and soft joints that its file does not have, is recorded
and diagnosed from its joints. Then the robot's own program walks, unmodified, over the emulated bus
once with the file as it was and once with the better model; and both are compared with how the
robot itself walked a walk that the diagnosis has not seen. At last a fast gait is searched on the
first model, and the search goes on from there on both, as long, on each as far below the limit of
torque as it is short of torque in the recorded walks; the robot itself walks what either found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from bench.blind.legged_sizing import passing
from bench.blind.scenes import SCENES, play
from bench.diagnosis.journal import FOLDER, Journal
from bench.diagnosis.robot.features import Features
from bench.diagnosis.robot.judging import Judgement, rmse_rad, steady_rmse_rad
from bench.diagnosis.robot.picture import phase_figure
from bench.diagnosis.robot.replay import course
from bench.diagnosis.robot.running import run_robot
from bench.diagnosis.running import Split
from bench.diagnosis.watch import Say, Watch
from bench.figures.style import save
from bench.files import finite, write_json
from bench.motions import WalkPlan
from bench.recording import Recording, joint_track, read, write
from bench.running import Steering, in_process, walk_in
from busemu.tables import Robot, load_robot
from busemu.timing import load_profile
from sim.world import BulletPlant

from . import loop_gaits
from .stance_runs import LOADS_KG, SCENE, Cause, Run, recording_of, specimen

FORMAT = "busemu-loop-study/1"
SECONDS = 10.0  #: of a walk; five seconds have fewer than three steady cycles
TIPS_N_M, JOINTS_RAD_NM = 800.0, 0.3  #: what is hidden
#: walks that fit, by name, and the one that judges the diagnosis
FITTED = {
    "straight-1": WalkPlan(SECONDS),
    "straight-2": WalkPlan(SECONDS, seed=3),
    "loaded": WalkPlan(SECONDS, payload_kg=LOADS_KG[1]),
}
JUDGING = {"turn": WalkPlan(SECONDS, v_left=0.4, v_right=1.4)}
#: the walk that nobody has seen before
UNSEEN = WalkPlan(SECONDS, v_left=1.3, v_right=0.9, seed=7)


@dataclass(frozen=True, slots=True)
class Walked:
    """A walk: what the program recorded, and how far the trunk came [m]."""

    recording: Recording
    travelled_m: float


def hidden(seed: int) -> Run:
    """The robot that is recorded: both causes, and ordinary tolerances of its own."""
    return Run(1, Cause.BOTH, 0.0, TIPS_N_M, JOINTS_RAD_NM, seed)


def really(run: Run, plan: WalkPlan, name: str, late: float = 0.0) -> Walked:
    """A walk of the robot itself; ``late`` in its session the battery is a little lower."""
    scene = SCENES[SCENE]
    whole = passing(specimen(run, plan), late)
    played = play(scene, plan, whole.body, whole.electrics)
    recording = recording_of(scene.robot, played, name, plan.payload_kg)
    return Walked(recording, _far(played.plant.observe()))


def emulated(robot: Robot, plan: WalkPlan, name: str) -> Walked:
    """The same program over the emulated bus, with the robot of a file behind it."""
    plant = BulletPlant(robot, trunk_load_kg=plan.payload_kg)
    try:
        session = in_process(robot, plant, load_profile(robot.timing))
        steering = Steering(
            seconds=plan.seconds, v_left=plan.v_left, v_right=plan.v_right, seed=plan.seed
        )
        walk_in(session, steering)
        return Walked(session.recording(name, name), _far(plant.observe()))
    finally:
        plant.close()


def _far(seen: Any) -> float:
    return math.hypot(seen["mocap/base_x_m"], seen["mocap/base_y_m"])


def compared(robot: Robot, real: Recording, other: Recording) -> Judgement:
    """One walk as another shows it: angles at the instants at which the first was read."""
    modelled = []
    for mount in robot.servos:
        track, shown = (joint_track(one, mount.joint, robot) for one in (real, other))
        modelled.append(np.interp(track.position_t_s, shown.position_t_s, shown.position_rad))
    return Judgement(course(real, robot), tuple(modelled))


def study(seed: int, out: Path, say: Say) -> dict[str, Any]:
    """Run the study into a folder; ``loop.json``, ``loop.png`` and the diagnosis. The result."""
    out.mkdir(parents=True, exist_ok=True)
    run, base = hidden(seed), load_robot("marvin")
    recorded = {
        name: _recorded(run, plan, name, out / "recordings", say)
        for name, plan in (FITTED | JUDGING).items()
    }
    parts = Split(
        tuple(recorded[name] for name in FITTED), tuple(recorded[name] for name in JUDGING)
    )
    folder = out / "diagnosis"
    folder.mkdir(exist_ok=True)
    journal = Journal(folder / FOLDER)
    answers = run_robot(base, parts, folder, date.today(), watch=Watch(say), journal=journal)
    better = load_robot(folder / "model.toml")
    say("walking a walk that nobody has seen")
    real, again = really(run, UNSEEN, "unseen"), really(run, UNSEEN, "unseen-again", late=1.0)
    say("walking it over the emulated bus, before and after")
    before, after = emulated(base, UNSEEN, "before"), emulated(better, UNSEEN, "after")
    shown = {
        name: compared(base, real.recording, other.recording)
        for name, other in (("floor", again), ("before", before), ("after", after))
    }
    walk = Features.of(course(real.recording, base), base)
    result = {
        "format": FORMAT,
        "seed": seed,
        "hidden": run.told(),
        "causes": [{"effect": c.effect, "scope": list(c.scope)} for c in answers.diagnosis.causes],
        "rmse_rad": {name: rmse_rad([one]) for name, one in shown.items()},
        "walking_rmse_rad": {name: steady_rmse_rad([walk], [one]) for name, one in shown.items()},
        "travelled_m": {
            "real": real.travelled_m,
            "real again": again.travelled_m,
            "before": before.travelled_m,
            "after": after.travelled_m,
        },
        "seconds": UNSEEN.seconds,
    }
    save(
        phase_figure(base, shown["before"], shown["after"], "a walk that nobody has seen"),
        out / "loop.png",
    )
    write_json(out / "loop.json", finite(result))
    known = [(plan, recorded[name]) for name, plan in (FITTED | JUDGING).items()]
    known.append((UNSEEN, real.recording))
    result["gaits"] = _gaits(run, {"before": base, "after": better}, known, out, say)
    write_json(out / "loop.json", finite(result))
    journal.finished()
    return result


def _gaits(
    run: Run,
    models: dict[str, Robot],
    known: Sequence[tuple[WalkPlan, Recording]],
    out: Path,
    say: Say,
) -> dict[str, Any]:
    """A gait searched on each model, and walked by the robot; ``known`` walks are of the robot."""
    base = models["before"]
    short = {}
    for name, model in models.items():
        say(f"looking how far the model {name} is short of torque")
        walks = [
            (real, emulated(model, plan, name).recording, plan.seconds) for plan, real in known
        ]
        short[name] = loop_gaits.short_of_torque(base, walks)
    begin = None
    for _ in range(2):  # from the file's gait, and from what was found
        begin = loop_gaits.searched(
            base, short["before"], out / "gaits-before", say, begin
        ).candidate
    found = {
        name: loop_gaits.searched(model, short[name], out / f"gaits-{name}", say, begin)
        for name, model in models.items()
    }
    return {name: loop_gaits.told(run, one, short[name], say) for name, one in found.items()}


def _recorded(run: Run, plan: WalkPlan, name: str, folder: Path, say: Say) -> Recording:
    path = folder / f"{name}.parquet"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        say(f"walking: {name}")
        write(really(run, plan, name).recording, path)
    return read(path)


def lines(result: dict[str, Any]) -> Sequence[str]:
    """The result in words."""
    whole, rmse = result["rmse_rad"], result["walking_rmse_rad"]
    far = result["travelled_m"]
    names = ", ".join(f"{c['effect']} of {len(c['scope'])}" for c in result["causes"])
    return [
        f"found: {names or 'nothing'}",
        f"joints over the emulated bus against the robot, walking: {1e3 * rmse['before']:.2f} mrad "
        f"before, {1e3 * rmse['after']:.2f} after; the robot against itself "
        f"{1e3 * rmse['floor']:.2f}",
        f"standing up as well: {1e3 * whole['before']:.2f} mrad before, {1e3 * whole['after']:.2f} "
        f"after; the robot against itself {1e3 * whole['floor']:.2f}",
        f"travelled in {result['seconds']:g} s: robot {far['real']:.3f} m, before "
        f"{far['before']:.3f}, after {far['after']:.3f}",
        *loop_gaits.lines(result["gaits"]),
    ]
