"""The whole thing once: serve a robot, time its bus, let it walk, and show what happened.

Everything on the bus goes over a pseudo-terminal in wall-clock time, by the same commands a person
would type; the times of the model come from the same client in virtual time.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from busemu.plant import ideal
from busemu.tables import Robot
from busemu.timing import load_profile
from busemu.wording import amount
from hal.bus_errors import BusError
from hal.cpg import LocomotionController

from .bus_timing import WRITE_NOTE, Timed, time_bus
from .figures.film import film_strip, write_gif
from .figures.gait import contact_spans, gait_figure
from .figures.joints import joint_figure
from .figures.path import Displacement, displacement, path_figure
from .figures.style import save
from .figures.tables import aligned, markdown
from .figures.timing import TimingRow, timing_figure
from .files import replacing, write_text
from .recording import Recording, read
from .recording.joints import joint_track
from .running import in_process, on_port

Floats = NDArray[np.float64]
Say = Callable[[str], None]

#: A server that has not opened its port after so long has failed [s]. Assumed: PyBullet and the
#: compiled drive load in a few seconds even on a slow machine.
START_S = 120.0
#: Why a bus on a pseudo-terminal loses replies, and what to do.
BUSY = "the machine is busy; the server needs a core of its own, so try with nothing else running"
#: Times longer than modelled, in the median, that tell of a busy machine. Assumed: an idle one is
#: within 5 %.
SLOW = 1.25
#: Frames a second of the film, and how much of the walk it shows [s].
FRAMES_S = 12.5
FILM_S = 4.0
#: The part of the walk that the detailed pictures show [s], from the first step on.
WINDOW_S = 5.0


class DemoError(RuntimeError):
    """The demo could not go on: says what failed."""


@dataclass(frozen=True, slots=True)
class Demo:
    """What a demo left behind."""

    folder: Path
    table: str
    moved: Displacement
    files: dict[str, str]  #: file name -> what it shows


@contextmanager
def served(robot: Robot, name: str, folder: Path) -> Iterator[str]:
    """Serve ``robot`` in a process of its own; gives the port's path. What it saw is kept."""
    link = folder / "port"
    command = [sys.executable, "-m", "busemu", "serve", "--robot", name, "--link", str(link)]
    log = folder / "server.txt"
    with log.open("w", encoding="utf-8") as output:
        server = subprocess.Popen(
            [*command, "--observe", str(folder / "observed.csv")],
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # Ctrl-C is for this process, which then stops the server
        )
        try:
            _until_serving(server, log)
            yield str(link)
        finally:
            server.send_signal(signal.SIGINT)
            try:
                server.wait(30.0)
            except subprocess.TimeoutExpired:
                server.kill()
                server.wait()


def _until_serving(server: subprocess.Popen[bytes], log: Path) -> None:
    until_s = time.monotonic() + START_S
    while "port " not in log.read_text("utf-8"):
        if server.poll() is not None:
            raise DemoError(f"the server did not start: {log.read_text('utf-8').strip()}")
        if time.monotonic() > until_s:
            raise DemoError(f"the server has not opened its port in {START_S:.0f} s: see {log}")
        time.sleep(0.02)


def run_demo(robot: Robot, name: str, folder: Path, seconds: float, say: Say) -> Demo:
    """Run the demo into ``folder``. Raises :class:`DemoError`, :class:`RobotError`."""
    LocomotionController.of(robot, seed=0)  # a robot that cannot walk is refused at once
    folder.mkdir(parents=True, exist_ok=True)
    files = {}
    say("the model: timing every transaction in virtual time")
    modelled = time_bus(in_process(robot, ideal(robot), load_profile(robot.timing)), 10)
    say("serving: the robot's servos on a pseudo-terminal, PyBullet behind them")
    with served(robot, name, folder) as port:
        say(f"measuring the bus through the SDK on {port}")
        try:
            with on_port(robot, port) as session:
                measured = time_bus(session)
                late = session.client.statistics.failed
        except BusError as error:
            said = folder / "server.txt"
            raise DemoError(f"{error}: {BUSY}; what the server said is in {said}") from None
        for hint in hindered(measured, modelled, late):
            say(hint)
        walk = [sys.executable, "-m", "busemu", "walk", "--robot", name, "--port", port]
        walk += ["--seconds", f"{seconds:g}", "--record", str(folder / "walk.parquet")]
        say(f"walking: busemu {' '.join(walk[3:])}")
        if subprocess.run(walk, check=False).returncode != 0:
            raise DemoError("the walk failed: see the line above")
    files["walk.parquet"] = "the recording: every register written and read, with times"
    files["observed.csv"] = "what an observer beside the robot saw: pose, contacts, joints"
    files["server.txt"] = "what the server said"
    say("drawing")
    table, rows = _timing(robot, measured, modelled)
    save(
        timing_figure(rows, title=f"{robot.name}: time a transaction takes"), folder / "timing.png"
    )
    files["timing.png"] = "time of every transaction: measured, modelled, thesis"
    recording, observed = read(folder / "walk.parquet"), read(folder / "observed.csv")
    moved = _pictures(robot, recording, observed, seconds, folder, files)
    _film(robot, observed, _start_s(recording, seconds), folder, files)
    summary = _summary(robot, table, moved, files)
    write_text(folder / "README.md", summary)
    return Demo(folder, f"{aligned(*table)}\n{WRITE_NOTE}", moved, files)


def hindered(measured: list[Timed], modelled: list[Timed], late: int) -> list[str]:
    """What shows that the machine was too busy to measure, in a line or none."""
    slow = [
        live.what
        for live, model in zip(measured, modelled, strict=True)
        if live.kind != "write all" and live.median_s > SLOW * model.median_s
    ]
    told = [f"{amount(late, 'reply was', 'replies were')} lost and asked for again"] if late else []
    told += [f"{len(slow)} of {len(measured)} kinds of transaction took too long"] if slow else []
    return [f"{', '.join(told)}: {BUSY}"] if told else []


Table = tuple[list[str], list[list[str]]]


def _timing(
    robot: Robot, measured: list[Timed], modelled: list[Timed]
) -> tuple[Table, list[TimingRow]]:
    columns = ["transaction", "thesis [ms]", "modelled [ms]", "measured [ms]", "5 % - 95 % [ms]"]
    lines, rows = [], []
    for live, model in zip(measured, modelled, strict=True):
        thesis = live.thesis_ms(robot.name)
        row = TimingRow(
            live.kind,
            live.times_s,
            model.median_s,
            thesis[0] / 1e3 if thesis else None,
            thesis_is_bound=bool(thesis and thesis[1]),
        )
        low, middle, high = (value * 1e3 for value in row.summary_s)
        given = "" if thesis is None else f"{'under ' if thesis[1] else ''}{thesis[0]:g}"
        lines.append(
            [live.what, given, f"{model.median_s * 1e3:.2f}", f"{middle:.2f}",
             f"{low:.2f} - {high:.2f}"]
        )  # fmt: skip
        rows.append(row)
    return (columns, lines), rows


def _start_s(recording: Recording, seconds: float) -> float:
    """When the walking began [s, host's clock]: ``seconds`` before the last goal."""
    last = max(
        float(recording.series(servo, "goal_position", "write").t_sample_s[-1])
        for servo in recording.servo_ids
    )
    return last - seconds


def _pictures(
    robot: Robot,
    recording: Recording,
    observed: Recording,
    seconds: float,
    folder: Path,
    files: dict[str, str],
) -> Displacement:
    start_s = _start_s(recording, seconds)
    window_s = (0.0, min(WINDOW_S, seconds))
    stances = {}
    for row in robot.document.get("leg", []):
        force = observed.observed(f"contact/{row['name']}_n")
        stances[row["name"]] = contact_spans(force.t_sample_s - start_s, force.value)
    leg = next(iter(stances))
    tracks = [
        joint_track(recording, f"{leg}.{joint}", robot).since(start_s)
        for joint in ("coxa", "femur", "tibia")
    ]
    save(joint_figure(tracks, stance=stances[leg], window_s=window_s), folder / "joints.png")
    files["joints.png"] = f"joints of {leg}: goals and measured positions"
    save(gait_figure(stances, window_s=window_s), folder / "gait.png")
    files["gait.png"] = "gait diagram: which foot is down when"
    times = observed.observed("mocap/base_x_m").t_sample_s - start_s
    walked = (times >= 0.0) & (times <= seconds)
    pose = [observed.observed(f"mocap/base_{k}").value[walked] for k in ("x_m", "y_m", "yaw_rad")]
    save(path_figure(times[walked], *pose), folder / "path.png")
    files["path.png"] = "path of the body from above"
    return displacement(times[walked], *pose)


def _film(
    robot: Robot, observed: Recording, start_s: float, folder: Path, files: dict[str, str]
) -> None:
    from sim.picture import Pose, render  # noqa: PLC0415 - the engine loads only for pictures

    names = ("x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad")
    times = observed.observed("mocap/base_x_m").t_sample_s - start_s
    instants = np.arange(0.0, FILM_S, 1.0 / FRAMES_S)
    at = np.searchsorted(times, instants).clip(0, len(times) - 1)
    base = [observed.observed(f"mocap/base_{name}").value for name in names]
    joints = {s.joint: observed.observed(f"rig/{s.joint}_rad").value for s in robot.servos}
    poses = []
    for i in at.tolist():
        x, y, z, roll, pitch, yaw = (float(values[i]) for values in base)
        angles = {name: float(values[i]) for name, values in joints.items()}
        poses.append(Pose(x, y, z, roll, pitch, yaw, angles))
    frames = list(render(robot, poses))
    strip = film_strip(frames, [float(t) for t in instants], count=6, columns=3)
    with replacing(folder / "film.png") as file:
        strip.save(file, format="PNG")
    files["film.png"] = "the robot walking, six instants"
    write_gif(frames, folder / "walk.gif", frame_s=1.0 / FRAMES_S)
    files["walk.gif"] = "the robot walking"


def _summary(robot: Robot, table: Table, moved: Displacement, files: dict[str, str]) -> str:
    shown = "\n".join(f"| `{name}` | {what} |" for name, what in files.items())
    pictures = "\n\n".join(
        f"![{files[name]}]({name})"
        for name in ("walk.gif", "timing.png", "joints.png", "gait.png", "path.png")
    )
    return f"""# {robot.document.get("title", robot.name)}: a walk over an emulated bus

It walked {moved.distance_m:.3f} m in {moved.duration_s:.1f} s ({moved.speed_m_s * 100:.1f} cm/s)
and turned by {np.degrees(moved.turned_rad):+.1f} degrees.

{markdown(*table)}

{WRITE_NOTE.replace("*", chr(92) + "*")}

| file | what |
|---|---|
{shown}

{pictures}
"""
