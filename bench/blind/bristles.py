"""Dry friction that gives way a little before it breaks away: bristles that bend, then slip."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: share of critical by which bent bristles damp the rotor; assumed
DAMPED = 0.5


@dataclass(slots=True)
class Bristles:
    """A spring that slips at the friction's level, with a damper beside it while it sticks.

    After Dupont, Hayward, Armstrong and Altpeter, *IEEE Trans. Autom. Control* 47 (2002); all at
    the output shaft.
    """

    stiffness_nm_rad: float
    inertia_kg_m2: float  #: of the rotor
    step_s: float  #: between two calls
    bent_rad: float = 0.0

    def torque(self, velocity_rad_s: float, level_nm: float) -> float:
        """What they pull with after a step at a velocity [N m], never more than the level."""
        most = level_nm / self.stiffness_nm_rad
        bent = self.bent_rad + velocity_rad_s * self.step_s
        self.bent_rad = min(max(bent, -most), most)
        pulled = self.stiffness_nm_rad * self.bent_rad
        if self.bent_rad == bent:
            critical = 2.0 * math.sqrt(self.stiffness_nm_rad * self.inertia_kg_m2)
            pulled += DAMPED * critical * velocity_rad_s
        return -min(max(pulled, -level_nm), level_nm)
