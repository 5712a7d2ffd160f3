"""Whether a gear is soft enough for a step: checked before anything moves.

The engine holds a gear's mean torque constant over a step ``h`` while the drive assumes that the
shaft keeps its velocity. For one shaft of inertia ``I`` on a gear of stiffness ``k`` and damping
``c`` with its rotor held, one step of that scheme is, with ``W = k h^2 / I`` and ``D = c h / I``::

    v' = v - W q - (W / 2 + D) v          (v in rad a step)
    q' = q + v'

whose eigenvalues stay inside the unit circle as long as ``W + D < 2``. For a robot, ``W + D`` is
the largest eigenvalue of ``(K h^2 + C h)`` times the inverse of its mass matrix. Contact only takes
freedom away, which cannot raise it.
"""

from __future__ import annotations

import numpy as np

from .drive import kernel
from .drive.kernel import Array
from .entries import PhysicsError

LARGEST = 1.6  #: four fifths of the limit, for what the checked postures miss


def stiffness_number(params: Array, inverse_mass: Array, step_s: float) -> float:
    """``W + D`` of the stiffest mode: stable below 2.

    ``params`` is the kernel's parameter array, ``inverse_mass`` the joints' part of the inverse
    mass matrix [1/(kg m^2)], shape (joints, joints), in the same order.
    """
    gear = params[kernel.GEAR_STIFFNESS] * step_s**2 + params[kernel.GEAR_DAMPING] * step_s
    root = np.sqrt(gear)
    symmetric = root[:, None] * inverse_mass * root[None, :]
    return float(np.linalg.eigvalsh(0.5 * (symmetric + symmetric.T))[-1])


def too_stiff(number: float, step_s: float, where: str) -> PhysicsError:
    """The error for a stiffness number beyond :data:`LARGEST`."""
    return PhysicsError(
        f"{where}: gear_stiffness_nm_rad and gear_damping_nm_s_rad are too high for these "
        f"links at a step of {step_s * 1e3:g} ms: k h^2/I + c h/I is {number:.3g}, at most "
        f"{LARGEST:g} is allowed; soften the gear or shorten the step"
    )
