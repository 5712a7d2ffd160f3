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

from collections.abc import Mapping, Sequence

import numpy as np

from .drive import fields
from .drive.fields import Array
from .drive.parameters import DriveParameters, pack
from .entries import PhysicsError

LARGEST = 1.6  #: four fifths of the limit, for what the checked postures miss


def stiffness_number(params: Array, inverse_mass: Array, step_s: float) -> float:
    """``W + D`` of the stiffest mode: stable below 2.

    ``params`` is the kernel's parameter array, ``inverse_mass`` the joints' part of the inverse
    mass matrix [1/(kg m^2)], shape (joints, joints), in the same order.
    """
    gear = params[fields.GEAR_STIFFNESS] * step_s**2 + params[fields.GEAR_DAMPING] * step_s
    root = np.sqrt(gear)
    symmetric = root[:, None] * inverse_mass * root[None, :]
    return float(np.linalg.eigvalsh(0.5 * (symmetric + symmetric.T))[-1])


def bearable(
    drives: Mapping[str, DriveParameters],
    inverse_masses: Sequence[Array],
    tick_s: float,
    choices: Sequence[int],
    where: str,
) -> tuple[int, float]:
    """Steps per tick [s] that the gears of some joints bear in every posture, and their number.

    The first of the ``choices`` that will do. Raises :class:`PhysicsError` where none does.
    """
    params = pack(list(drives.values()))
    for steps in choices:
        step_s = tick_s / steps
        numbers = [stiffness_number(params, inverse, step_s) for inverse in inverse_masses]
        number = max(numbers)
        if number <= LARGEST:
            return steps, number
    worst = inverse_masses[numbers.index(number)]
    gear = _stiffest(params, worst, step_s, number, tuple(drives))
    raise PhysicsError(
        f"{where}: {gear} too high for these links at a step of {step_s * 1e3:g} ms: "
        f"k h^2/I + c h/I is {number:.3g}, at most {LARGEST:g} is allowed; soften the gear, or "
        "hang more on the joint"
    )


def _stiffest(
    params: Array, inverse_mass: Array, step_s: float, number: float, names: Sequence[str]
) -> str:
    """The gear that most makes a stiffness number what it is: its values and what they may be."""
    stiffness, damping = params[fields.GEAR_STIFFNESS], params[fields.GEAR_DAMPING]
    own = (stiffness * step_s**2 + damping * step_s) * np.diag(inverse_mass)
    i = int(np.argmax(own))
    if not np.isfinite(stiffness[i]):
        soft = params.copy()
        soft[fields.GEAR_STIFFNESS], soft[fields.GEAR_DAMPING] = 1.0, 0.0
        most = LARGEST / stiffness_number(soft, inverse_mass, step_s)
        return (
            f"{names[i]}: no gear_stiffness_nm_rad is given, and a rigid gear (inf N m/rad, at "
            f"most {most:.3g}) is"
        )
    spring, damper = stiffness[i] * step_s**2, damping[i] * step_s
    allowed = LARGEST / number * (spring + damper)
    has_k = f"{names[i]}: gear_stiffness_nm_rad = {stiffness[i]:g} N m/rad"
    has_c = f"gear_damping_nm_s_rad = {damping[i]:g} N m s/rad"
    if allowed > damper:
        return f"{has_k} (at most {(allowed - damper) / step_s**2:.3g} beside {has_c}) is"
    if allowed > spring:
        most = (allowed - spring) / step_s
        return f"{names[i]}: {has_c} (at most {most:.3g} beside {has_k.partition(': ')[2]}) is"
    return f"{has_k} and {has_c} (each alone) are"
