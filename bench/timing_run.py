"""The command ``busemu timing``: measure, show, write, fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from busemu.tables import Robot
from busemu.timing import Profile
from busemu.wording import amount

from .calibration import fit, predict
from .probes import Prober, Timing, prober_in_process, prober_on_port, probes_of
from .return_delays import TRIED, time_at_each
from .timing_report import (
    cycle_lines,
    describe_fit,
    timing_table,
    unsteady,
    write_profile,
    write_report,
)

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to time and what to leave behind. Without a ``port``, the model itself is timed."""

    robot: Robot
    robot_name: str  #: as it was given: a name, a file or servos of a model
    profile: Profile
    port: str | None
    repeats: int
    vary_return_delay: bool = False
    out: Path | None = None
    fit: Path | None = None


def run_timing(wanted: Wanted, say: Say) -> list[Timing]:
    """Time the bus and say what was found. Returns the timings.

    Raises :class:`hal.bus_errors.BusError`, :class:`bench.return_delays.ReturnDelayError`,
    :class:`bench.calibration.CalibrationError` or ``OSError``.
    """
    robot, profile = wanted.robot, wanted.profile
    if wanted.out is not None:
        wanted.out.mkdir(parents=True, exist_ok=True)
    with _prober(wanted) as prober:
        timings = _measure(prober, wanted)
    modelled_s = None
    if wanted.port is not None:
        modelled_s = predict(robot, profile, [(t.probe, t.condition) for t in timings])
    where = wanted.port or f"the model, timing {profile.name}"
    servos = f"{amount(len(robot.servos), 'servo')}, {robot.baud_rate} baud"
    say(f"{robot.name} on {where}: {servos}, {amount(wanted.repeats, 'time')} each")
    say(timing_table(timings, modelled_s, profile.name))
    for line in cycle_lines(timings):
        say(line)
    warning = unsteady(timings)
    if warning is not None:
        say(warning)
    if wanted.out is not None:
        for path in write_report(wanted.out, robot, timings, modelled_s):
            say(f"wrote {path}")
    if wanted.fit is not None:
        _fit(wanted, timings, say)
    return timings


def _prober(wanted: Wanted) -> AbstractContextManager[Prober]:
    if wanted.port is None:
        return nullcontext(prober_in_process(wanted.robot, wanted.profile))
    return prober_on_port(wanted.robot, wanted.port)


def _measure(prober: Prober, wanted: Wanted) -> list[Timing]:
    probes = probes_of(wanted.robot)
    rounds = len(TRIED) if wanted.vary_return_delay else 1
    with _bar(rounds * len(probes)) as progress:
        if wanted.vary_return_delay:
            return time_at_each(prober, probes, wanted.repeats, progress)
        return prober.time(probes, wanted.repeats, progress)


def _fit(wanted: Wanted, timings: list[Timing], say: Say) -> None:
    assert wanted.fit is not None
    where = wanted.port or f"the model with timing {wanted.profile.name}"
    source = (
        f"fitted by busemu timing to {where}: {wanted.robot.name}, "
        f"{wanted.robot.baud_rate} baud, medians of {wanted.repeats}"
    )
    fitted = fit(wanted.robot, timings, wanted.fit.stem, source)
    say("")
    for line in describe_fit(fitted):
        say(line)
    if not wanted.vary_return_delay:
        say("with --vary-return-delay the servos' turnaround can be told apart, too")
    write_profile(fitted, wanted.fit)
    use = f"busemu serve --robot {wanted.robot_name} --timing {wanted.fit}"
    say(f"wrote {wanted.fit}: use it with {use}")


@contextmanager
def _bar(total: int) -> Iterator[Callable[[], None] | None]:
    """Yield what is told of each finished probe; nothing where no terminal is."""
    from rich.console import Console  # noqa: PLC0415 - only a terminal needs it
    from rich.progress import Progress  # noqa: PLC0415

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    with Progress(console=console, transient=True, auto_refresh=False) as bar:
        task = bar.add_task("timing", total=total)
        yield lambda: bar.update(task, advance=1, refresh=True)
