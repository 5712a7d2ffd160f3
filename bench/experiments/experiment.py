"""What an experiment is: trials to run over the bus, and what their recordings say.

A *trial* is one repeat under one condition and becomes one recording. Evaluation takes recordings
alone, so those of a real robot are evaluated by the same code; what stood beside an emulated robot
(``rig/...``, ``contact/...``, ``mocap/...``) lies in the same recording and is used where it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

from matplotlib.figure import Figure

from busemu.tables import Robot

from ..recording import Recording
from ..running import Session

#: Told the time [s] that a trial has run.
Progress = Callable[[float], None]

R = TypeVar("R", bound="Result")

RAW_DATA = "the thesis's raw recordings are not published"


class ExperimentError(RuntimeError):
    """An experiment that cannot be run or evaluated: says what is wrong and what to do."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One repeat under one condition.

    ``condition`` goes into the recording's metadata. ``held``: the trunk is on a stand, no foot on
    the ground. ``clamps`` block joints between two angles [rad]. ``seed`` draws whatever differs
    between repeats.
    """

    name: str
    repeat: int
    seed: int
    seconds: float  #: about how long it takes [s]
    held: bool = False
    trunk_load_kg: float = 0.0
    clamps: Mapping[str, tuple[float, float]] = field(default_factory=lambda: MappingProxyType({}))
    condition: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    def facts(self) -> dict[str, Any]:
        """The recording's ``condition`` table, as far as it is known beforehand."""
        return {
            "support": "suspended" if self.held else "ground",
            "payload_kg": self.trunk_load_kg,
            "repeat": self.repeat,
            "seed": self.seed,
            **self.condition,
        }


@dataclass(frozen=True, slots=True)
class Comparison:
    """A number of ours beside the thesis's; ``why_not`` says why they are not the same quantity."""

    what: str
    ours: str
    thesis: str
    why_not: str = ""

    @property
    def comparable(self) -> bool:
        """Whether the two numbers measure the same thing."""
        return not self.why_not


@dataclass(frozen=True, slots=True)
class Choice:
    """What a user may choose of an experiment."""

    repeats: int = 5  #: as in the thesis
    seed: int = 0
    leg: str = "leg6"  #: the leg of servo check and leg step: right middle
    joint: str | None = None  #: of the servo check on a rig; none: its first
    seconds: float = 10.0  #: of walking, as in the thesis
    v_left: float = 1.0
    v_right: float = 1.0


class Result(Protocol):
    """What an experiment found, in SI."""

    @property
    def robot(self) -> str:
        """Name of the robot."""

    def numbers(self) -> dict[str, Any]:
        """All numbers, as JSON can hold them; units in the names."""

    def comparisons(self) -> tuple[Comparison, ...]:
        """Numbers beside the thesis's."""

    def findings(self) -> tuple[str, ...]:
        """What a reader should know, a sentence each."""


class Experiment(Protocol[R]):
    """One of the experiments; ``result`` of :meth:`draw` is what :meth:`evaluate` gave."""

    name: str
    title: str
    figures: str  #: the thesis's figures it answers
    description: str

    def trials(self, robot: Robot, choice: Choice) -> tuple[Trial, ...]:
        """All trials, in the order they run in. Raises :class:`ExperimentError`."""

    def preparation(self, robot: Robot, trial: Trial) -> str:
        """What a person must do with a real robot before ``trial``, in words."""

    def run(self, session: Session, trial: Trial, progress: Progress) -> Mapping[str, Any]:
        """Run a trial; the session's recorder keeps all that was written and read.

        Returns what is to be added to the recording's ``condition``. The torque is off afterwards,
        however it ends. Raises :class:`ExperimentError` or :class:`hal.bus_errors.BusError`.
        """

    def evaluate(self, recordings: Sequence[Recording]) -> R:
        """What recordings of this experiment say.

        Raises :class:`ExperimentError` or :class:`bench.recording.RecordingError`.
        """

    def draw(self, result: R) -> Figure:
        """The figure, laid out as the thesis's."""
