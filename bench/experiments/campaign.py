"""Running an experiment's trials, keeping each as it finishes, and going on where one broke off.

A folder holds ``recordings/NAME.parquet``, one a trial, ``figure.png`` and ``result.json``. A trial
whose recording is there is not run again; a folder of another robot, seed or condition is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busemu.tables import Robot
from busemu.timing import load_profile
from hal.legs import quantity

from ..recording import Recording, read, write
from ..recording.metadata import fingerprint, plain, source_of
from ..running import Session, in_process, on_port
from .experiment import Experiment, ExperimentError, Progress, Trial

RECORDINGS = "recordings"

#: Told what is to be prepared before a trial; returns whether it is done.
Confirm = Callable[[str], bool]


@dataclass(frozen=True, slots=True)
class Campaign:
    """An experiment on one robot, with the folder its recordings go to.

    Without ``port``, each trial has an emulated robot of its own, in process and in virtual time.
    """

    experiment: Experiment[Any]
    robot: Robot
    trials: tuple[Trial, ...]
    folder: Path
    port: str | None = None

    def path(self, trial: Trial) -> Path:
        """Where a trial's recording goes."""
        return self.folder / RECORDINGS / f"{trial.name}.parquet"

    def facts(self, trial: Trial) -> dict[str, Any]:
        """What a trial's recording says of its condition.

        A robot that is served on a port lies on its belly. The supply of a real one is not known
        but for what its servos measure. An emulated one is told by its file, too, which may say
        another thing the next time: ``model`` is the first digits of its fingerprint.
        """
        facts = trial.facts()
        if self._served:
            facts["support"] = "ground"
        if self.port is None or self._served:
            facts["supply_v"] = quantity(self.robot.document, "supply", "voltage_v")
        if self.port is None:
            facts["model"] = fingerprint(self.robot)[:12]
        return facts

    def preparation(self, trial: Trial) -> str:
        """What a person must do before a trial on a port, in words."""
        if not self._served:
            return self.experiment.preparation(self.robot, trial)
        serve = f"busemu serve --robot {self.robot.name} --link {self.port}"
        if not trial.trunk_load_kg:
            return f"Start the emulated robot anew: {serve}"
        return (
            f"Start the emulated robot anew: {serve} --world FILE, whose [payload] has "
            f"mass_kg = {trial.trunk_load_kg:g} and at_m = [0, 0, 0]"
        )

    @property
    def _served(self) -> bool:
        """Whether the robot is an emulated one in another process."""
        return self.port is not None and source_of(self.port) == "emulator"

    def finished(self) -> dict[str, Recording]:
        """Recordings that are there already, by the name of their trial.

        Raises :class:`ExperimentError` for one that is not of this campaign, ``RecordingError``.
        """
        found = {}
        for trial in self.trials:
            path = self.path(trial)
            if path.exists():
                found[trial.name] = self._own(trial, read(path))
        return found

    def run(
        self, progress: Callable[[Trial], Progress], confirm: Confirm | None = None
    ) -> list[Recording]:
        """Run the trials that are not there yet; all recordings, in the order of the trials.

        ``progress`` is called for each trial that runs. ``confirm``, with a port, is asked before
        the first trial and whenever what is to be prepared changes; without it the robot must be
        prepared, and in one way for all trials.

        Raises :class:`ExperimentError`, :class:`hal.bus_errors.BusError`, ``RecordingError`` and
        ``KeyboardInterrupt``; trials finished until then are kept.
        """
        found = self.finished()
        left = [trial for trial in self.trials if trial.name not in found]
        prepared: str | None = None
        if self._served and any(trial.clamps for trial in left):
            raise ExperimentError(
                f"{self.robot.name} as busemu serve has it has no block to press against: leave "
                "--port away, then it gets one"
            )
        if self.port is not None and confirm is None:
            different = {self.preparation(trial) for trial in left}
            if len(different) > 1:
                raise ExperimentError(
                    f"the robot has to be prepared {len(different)} times in between, and nobody "
                    "would be asked: leave --yes away"
                )
        for trial in left:
            if self.port is not None and confirm is not None:
                words = self.preparation(trial)
                if words != prepared and not confirm(words):
                    raise ExperimentError("stopped before anything moved; nothing is switched on")
                prepared = words
            found[trial.name] = self._run(trial, progress(trial))
        return [found[trial.name] for trial in self.trials]

    def _run(self, trial: Trial, progress: Progress) -> Recording:
        path = self.path(trial)
        path.parent.mkdir(parents=True, exist_ok=True)
        with self._session(trial) as session:
            added = self.experiment.run(session, trial, progress)
            condition = {**self.facts(trial), **added}
            recording = session.recording(trial.name, self.experiment.name, **condition)
        write(recording, path)
        return read(path)  # what is evaluated is what was written

    @contextmanager
    def _session(self, trial: Trial) -> Iterator[Session]:
        if self.port is not None:
            with on_port(self.robot, self.port) as session:
                yield session
            return
        from sim.world import BulletPlant  # noqa: PLC0415 - a real robot needs no engine

        plant = BulletPlant(
            self.robot, held=trial.held, trunk_load_kg=trial.trunk_load_kg, clamps=trial.clamps
        )
        try:
            yield in_process(self.robot, plant, load_profile(self.robot.timing))
        finally:
            plant.close()

    def _own(self, trial: Trial, recording: Recording) -> Recording:
        """``recording`` if it is this trial's."""
        facts = recording.metadata
        condition = facts.get("condition", {})
        wanted: Mapping[str, Any] = plain(self.facts(trial))
        different = [key for key, value in wanted.items() if condition.get(key) != value]
        if recording.robot is None or recording.robot.name != self.robot.name:
            different.append("robot")
        if facts.get("group") != self.experiment.name:
            different.append("group")
        if (facts.get("source") == "real") and self.port is None:
            different.append("source")
        if different:
            raise ExperimentError(
                f"{recording.path} is of another run, with another "
                f"{' and '.join(different)}: choose another --out, or take the recordings away"
            )
        return recording


def recordings_in(folder: Path, experiment: str) -> list[Recording]:
    """All recordings of an experiment in a folder, or in its folder ``recordings``, by name.

    Which are its own says the metadata's ``group``. Raises :class:`ExperimentError` where there is
    none, ``RecordingError`` for one that is refused.
    """
    places = [folder, folder / RECORDINGS]
    paths = [
        path
        for place in places
        for kind in ("parquet", "csv")
        for path in sorted(place.glob(f"*.{kind}"))
    ]
    if not paths:
        raise ExperimentError(
            f"{folder}: no recording there: give a folder with NAME.parquet, or NAME.csv and .toml"
        )
    every = [read(path) for path in paths]
    wanted = [recording for recording in every if recording.metadata.get("group") == experiment]
    if not wanted:
        groups = sorted({str(recording.metadata.get("group")) for recording in every})
        raise ExperimentError(
            f"{folder}: none of the {len(every)} recordings is of group {experiment!r} "
            f"(there are {', '.join(groups)}): set group in the metadata of yours"
        )
    return wanted
