"""Output shaping: from the rhythm of the network to the angles of all joints.

Joint sinusoids would do, as in many CPG walkers, but on splayed legs they drag the feet: the foot
of a front leg that only swings its coxa moves on an arc across the way of the trunk. Here the
rhythm is shaped into a path of the foot, and inverse kinematics turns it into joint angles: in
stance all feet move as if nailed to one flat ground under a trunk that goes straight or turns.
Rhythm, phase and the choice of stance or swing still come from the network alone.

One number a leg, the *advance* ``c``, runs from +1/2 (touch-down, foot ahead) to -1/2 (lift-off)
evenly in stance, and returns in swing by a cubic that keeps the foot's speed at both ends. The foot
is where the neutral foot goes if the trunk steps back by ``c`` times the body's motion of one
stance. That motion follows from ``v_left`` and ``v_right``: a middle foot's way along the trunk is
``v * stride_m`` on its side, so equal values go straight forward (+y), unequal ones turn, opposite
ones turn on the spot. The front and rear feet do what a rigid trunk then asks of them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..legs import Legs, UnreachableError
from .gait import Gait
from .network import Rhythm

Array = npt.NDArray[np.float64]

#: Phase at which the extensor leads most: the middle of the stance.
MIDDLE_OF_STANCE = 0.25


class OutputShaping:
    """Shapes a rhythm into joint angles for one robot and gait."""

    def __init__(self, legs: Legs, gait: Gait) -> None:
        self.legs = legs
        self.gait = gait
        neutral = (gait.neutral_coxa_rad, gait.neutral_femur_rad, gait.neutral_tibia_rad)
        self.neutral_rad = legs.stretched(*neutral)
        self.neutral_feet_m = legs.feet_m(self.neutral_rad)
        #: Half the track: how far the two middle feet stand from the trunk's long axis.
        middle = np.argsort(np.abs(self.neutral_feet_m[:, 1]))[:2]
        self.half_track_m = float(np.abs(self.neutral_feet_m[middle, 0]).mean())

    def body_motion(self, v_left: float, v_right: float) -> tuple[float, float]:
        """Motion of the trunk in one stance: forward [m], and turn [rad], positive to the left."""
        stride_m = self.gait.stride_m
        return (
            0.5 * stride_m * (v_left + v_right),
            0.5 * stride_m * (v_right - v_left) / self.half_track_m,
        )

    def advance_and_lift(self, rhythm: Rhythm) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
        """Each foot's advance (1 is a whole stance), its lift [m], and whether it is in stance."""
        duty = self.gait.duty_factor
        since_touch_down = np.mod(rhythm.phase - MIDDLE_OF_STANCE + 0.5 * duty, 1.0)
        in_stance = since_touch_down < duty
        s = np.clip((since_touch_down - duty) / (1.0 - duty), 0.0, 1.0)  # share of the swing
        slope = -(1.0 - duty) / duty  # speed of the stance, in advance a swing
        returning = -0.5 + s * s * (3.0 - 2.0 * s) + slope * s * (1.0 - s) * (1.0 - 2.0 * s)
        advance = np.where(in_stance, 0.5 - since_touch_down / duty, returning)
        lift_m = np.where(in_stance, 0.0, self.gait.lift_m * 16.0 * (s * (1.0 - s)) ** 2)
        amplitude = np.minimum(rhythm.amplitude, 1.0)
        return amplitude * advance, amplitude * lift_m, in_stance

    def feet_m(self, advance: Array, lift_m: Array, v_left: float, v_right: float) -> Array:
        """Feet in the trunk's frame, (legs, 3)."""
        forward_m, turn_rad = self.body_motion(v_left, v_right)
        angle = turn_rad * advance
        way = forward_m * advance
        cos, sin = np.cos(angle), np.sin(angle)
        # The trunk moves on an arc: sin(a)/a and (1 - cos(a))/a, good at a = 0 as well.
        along = np.sinc(angle / np.pi)
        across = 0.5 * angle * np.sinc(angle / (2.0 * np.pi)) ** 2
        x, y, z = self.neutral_feet_m.T
        return np.stack(
            (cos * x - sin * y - across * way, sin * x + cos * y + along * way, z + lift_m), axis=1
        )

    def angles_rad(self, rhythm: Rhythm, v_left: float, v_right: float) -> Array:
        """Joint angles (legs, 3) for a rhythm. Raises :class:`UnreachableError`."""
        advance, lift_m, _ = self.advance_and_lift(rhythm)
        return self.legs.angles_rad(self.feet_m(advance, lift_m, v_left, v_right))

    def check(self, v_left: float, v_right: float) -> None:
        """Try a whole locked period of every leg.

        Raises :class:`UnreachableError` that says by how much the stride is too long.
        """
        try:
            self._try(v_left, v_right)
        except UnreachableError as error:
            try:
                self._try(0.0, 0.0)
            except UnreachableError as still:
                raise UnreachableError(
                    f"the gait is beyond the legs even without a stride ({still}): change its "
                    "neutral posture or lift_m"
                ) from None
            low, high = 0.0, 1.0
            for _ in range(12):
                middle = 0.5 * (low + high)
                try:
                    self._try(middle * v_left, middle * v_right)
                    low = middle
                except UnreachableError:
                    high = middle
            raise UnreachableError(
                f"v_left = {v_left:g}, v_right = {v_right:g} ask for too long a stride ({error}): "
                f"use at most {low * v_left:.2f} and {low * v_right:.2f}"
            ) from None

    def _try(self, v_left: float, v_right: float) -> None:
        n = len(self.legs.names)
        for phase in np.linspace(0.0, 1.0, 64, endpoint=False):
            rhythm = Rhythm(np.full(n, phase), np.ones(n), np.full(n, phase < 0.5))
            self.angles_rad(rhythm, v_left, v_right)
