"""Matsuoka's adaptive two-neuron oscillators, any number of them, coupled by inhibition.

Each unit is an extensor and a flexor neuron that inhibit each other and tire. For neuron ``i``::

    tau_r u'_i = -u_i - sum_j W_ij y_j - b v_i + s        y_i = max(u_i, 0)
    tau_a v'_i = -v_i + y_i

Source: K. Matsuoka, Biol. Cybern. 52 (1985) 367-376 and 56 (1987) 345-353. One unit alone
oscillates where ``1 + tau_r / tau_a < W < 1 + b`` (1985, two mutually inhibiting neurons).

Time here is in units of ``tau_r``. The equations are integrated by the classical fourth-order
Runge-Kutta method with the fixed step :data:`STEP`; between steps a state is interpolated linearly.
So it depends on the instant only, not on how often :meth:`Oscillators.advance` was called. ``u``
and ``v`` decay with time constants of 20 and 40 steps, far inside the method's stability limit (a
step of 2.78 time constants); halving the step moves a state by less than 1e-3 over ten periods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: The internal step, in units of tau_r: about 220 steps a period.
STEP = 0.05


@dataclass(frozen=True, slots=True)
class OscillatorParameters:
    """Weights of one unit; all without dimension. Values assumed, within Matsuoka's condition."""

    mutual_inhibition: float = 2.0  #: W between a unit's two neurons
    adaptation: float = 2.5  #: b
    adaptation_time: float = 2.0  #: tau_a / tau_r
    tonic_input: float = 1.0  #: s

    def __post_init__(self) -> None:
        low, high = 1.0 + 1.0 / self.adaptation_time, 1.0 + self.adaptation
        if not low < self.mutual_inhibition < high:
            raise ValueError(
                f"a unit oscillates with mutual_inhibition between {low:.3g} and {high:.3g} only, "
                f"not {self.mutual_inhibition:.3g}"
            )


class Oscillators:
    """Units coupled by inhibition: ``coupling[i, j]`` is how much unit j inhibits unit i.

    Extensors inhibit extensors and flexors flexors. ``state`` is (4, units): rows ``u`` of the
    extensors, ``u`` of the flexors, ``v`` of the extensors, ``v`` of the flexors.
    """

    def __init__(
        self,
        parameters: OscillatorParameters,
        coupling: Array,
        state: Array,
        *,
        step: float = STEP,
    ) -> None:
        n = len(coupling)
        if coupling.shape != (n, n) or state.shape != (4, n):
            raise ValueError(f"coupling {coupling.shape} and state {state.shape} do not fit")
        p = parameters
        unit = np.eye(n)
        inhibition = np.block(
            [[coupling, p.mutual_inhibition * unit], [p.mutual_inhibition * unit, coupling]]
        )
        # z = (u, v) flattened: z' = linear z + fired max(u, 0) + constant.
        neurons = 2 * n
        self._linear = np.zeros((2 * neurons, 2 * neurons))
        self._linear[:neurons, :neurons] = -np.eye(neurons)
        self._linear[:neurons, neurons:] = -p.adaptation * np.eye(neurons)
        self._linear[neurons:, neurons:] = -np.eye(neurons) / p.adaptation_time
        self._fired = np.vstack((-inhibition, np.eye(neurons) / p.adaptation_time))
        self._constant = np.concatenate((np.full(neurons, p.tonic_input), np.zeros(neurons)))
        self._neurons = neurons
        self._step = step
        self._next = np.ascontiguousarray(state, dtype=float).reshape(-1).copy()
        self._last = self._next
        self._behind = 0.0  # time from _next back to now; always less than a step

    @property
    def state(self) -> Array:
        """The state at the present instant, (4, units)."""
        share = self._behind / self._step
        z = self._next + share * (self._last - self._next)
        state: Array = z.reshape(4, -1)
        return state

    def advance(self, duration: float) -> None:
        """Go on by ``duration`` [tau_r]. Raises ``ValueError`` if it is negative."""
        if not duration >= 0.0:
            raise ValueError(f"an oscillator cannot go back by {duration}")
        self._behind -= duration
        while self._behind < 0.0:
            self._last = self._next
            self._next = self._stepped(self._next)
            self._behind += self._step

    def _stepped(self, z: Array) -> Array:
        h = self._step
        k1 = self._slope(z)
        k2 = self._slope(z + (0.5 * h) * k1)
        k3 = self._slope(z + (0.5 * h) * k2)
        k4 = self._slope(z + h * k3)
        k2 += k3
        k2 *= 2.0
        k1 += k2
        k1 += k4
        k1 *= h / 6.0
        k1 += z
        return k1

    def _slope(self, z: Array) -> Array:
        slope: Array = self._linear @ z
        slope += self._fired @ np.maximum(z[: self._neurons], 0.0)
        slope += self._constant
        return slope
