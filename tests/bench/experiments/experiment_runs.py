"""Running trials of the experiments in virtual time, for the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.experiments import EXPERIMENTS
from bench.experiments.campaign import Campaign
from bench.experiments.experiment import Choice, Trial
from bench.recording import Recording
from busemu.tables import load_robot


def quiet(trial: Trial) -> Callable[[float], None]:
    return lambda _: None


def campaign(name: str, robot: str, folder: Path, choice: Choice | None = None) -> Campaign:
    described = load_robot(robot)
    experiment = EXPERIMENTS[name]
    trials = experiment.trials(described, choice or Choice(repeats=1))
    return Campaign(experiment, described, trials, folder)


def ran(
    name: str,
    robot: str,
    folder: Path,
    choice: Choice | None = None,
    only: Callable[[Trial], bool] = lambda _: True,
) -> tuple[list[Recording], Any]:
    """Recordings of the wanted trials, and what they say."""
    every = campaign(name, robot, folder, choice)
    wanted = Campaign(
        every.experiment, every.robot, tuple(filter(only, every.trials)), every.folder
    )
    recordings = wanted.run(quiet)
    return recordings, every.experiment.evaluate(recordings)
