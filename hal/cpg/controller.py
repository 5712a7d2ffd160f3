"""The locomotion controller: network and output shaping together."""

from __future__ import annotations

from busemu.tables import Robot, RobotError

from ..legs import Legs
from .gait import Gait
from .network import Network
from .oscillator import Array
from .shaping import OutputShaping


class LocomotionController:
    """A robot's walk as a function of time: ``v_left`` and ``v_right`` in, joint angles out.

    ``seed`` draws the random states the network starts from. Arrays are in the order of
    :attr:`joints`, in rad.
    """

    def __init__(self, legs: Legs, gait: Gait, seed: int = 0) -> None:
        self.legs = legs
        self.gait = gait
        self.network = Network(legs, gait.period_s, seed)
        self.shaping = OutputShaping(legs, gait)

    @classmethod
    def of(cls, robot: Robot, seed: int = 0) -> LocomotionController:
        """Make the controller of a robot file. Raises ``RobotError`` naming what is missing."""
        legs, gait = Legs.of(robot), Gait.of(robot)
        try:
            return cls(legs, gait, seed)
        except RobotError as error:
            raise RobotError(f"{robot.path}: {error}") from None

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names: the order of all arrays."""
        return self.legs.joints

    @property
    def neutral_rad(self) -> Array:
        """The posture in the middle of the stance."""
        return self.shaping.neutral_rad.reshape(-1)

    def check(self, v_left: float, v_right: float) -> None:
        """Raise :class:`~hal.legs.UnreachableError` if the stride is too long for the legs."""
        self.shaping.check(v_left, v_right)

    def advance(self, duration_s: float, v_left: float, v_right: float) -> Array:
        """Go on by ``duration_s`` [s] and return the joint angles."""
        self.network.advance(duration_s)
        return self.shaping.angles_rad(self.network.rhythm(), v_left, v_right).reshape(-1)
