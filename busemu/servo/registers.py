"""How a servo's registers and its drive see each other, in both directions.

Down: the registers say what the drive shall do (:meth:`Behaviour.command`). Up: the state of the
drive becomes the ``present_*`` registers (:meth:`Behaviour.show`). Which rules hold is a matter of
the table: ``drive.law`` is ``compliance`` or ``pid`` for the models with joint and wheel mode
(:mod:`busemu.servo.joint_wheel`), ``operating_modes`` for the X series and MX with Protocol 2.0
(:mod:`busemu.servo.operating_modes`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from typing import Protocol

from ..plant import DriveCommand, ServoState
from ..tables import Register
from .joint_wheel import JointWheel
from .memory import Memory
from .operating_modes import OperatingModes
from .status import Refusal

#: Fills one register from the state of the drive.
Sensor = Callable[[ServoState], None]


class Behaviour(Protocol):
    """What a family of models does with its registers. Instants are those of the bus's clock."""

    @property
    def reacts(self) -> frozenset[str]:
        """The registers that :meth:`written` must be told of."""

    def power_on(self, state: ServoState, now_s: float) -> None:
        """Fill the registers that take their value from the servo itself."""

    def command(self) -> DriveCommand:
        """What the registers tell the drive now."""

    def show(self, state: ServoState, now_s: float) -> None:
        """Put the drive's state into the registers that a read may bring."""

    @property
    def quick(self) -> Mapping[str, Sensor]:
        """The registers of :attr:`shown` that can be shown alone, as they need the state only."""

    @property
    def shown(self) -> frozenset[str]:
        """All registers that :meth:`show` fills."""

    def refuse(self, register: Register, raw: int) -> Refusal | None:
        """Whether ``register`` may not become ``raw``, which its table allows."""

    def written(self, names: Set[str], state: ServoState, now_s: float) -> None:
        """Draw the conclusions from registers that were just written."""

    def forget_turns(self, state: ServoState, now_s: float) -> None:
        """Have the present position be within one turn; the servo holds where it stands."""

    def idle(self, state: ServoState, now_s: float, silent_s: float) -> bool:
        """Housekeeping; true where the command has changed.

        ``silent_s`` is how long the servo has had no instruction.
        """


def behaviour(memory: Memory) -> Behaviour:
    """The behaviour of the model that ``memory`` belongs to."""
    if memory.table.drive["law"] == "operating_modes":
        return OperatingModes(memory)
    return JointWheel(memory)
