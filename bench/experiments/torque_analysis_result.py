"""What a torque analysis found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.legs import PARTS

from .experiment import RAW_DATA, Comparison
from .motion import SLOW_EVERY_S
from .series import Floats, rms
from .weighing import DUTY, PAST_FRICTION, Weighing

#: A shutdown is seen so long after it at most [s]: its register is read at this pace.
SEEN_LATE_S = 1.5 * SLOW_EVERY_S
#: RMSE of torque in the thesis, in units of the stall torque.
THESIS_RMSE = {"phantomx": "0.17 to 0.20", "marvin": "0.001 to 0.04"}


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """One joint in one repeat while the tibia extends; arrays of shape (samples,)."""

    joint: str
    load_kg: float
    t_s: Floats  #: since the tibia began to move
    goal_rad: Floats
    position_rad: Floats
    torque_nm: Floats  #: from the position error, duty times stall torque
    past_friction_nm: Floats  #: the same, with friction against the joint's last motion
    true_nm: Floats  #: NaN where nobody knew it
    shut_down_s: float  #: NaN if it did not

    @property
    def before(self) -> NDArray[np.bool_]:
        """Which samples surely lie before a shutdown, shape (samples,)."""
        return ~(self.t_s >= self.shut_down_s - SEEN_LATE_S)


@dataclass(frozen=True, slots=True, eq=False)
class TorqueAnalysis:
    """Torques of the supporting middle leg, a course a joint, repeat and load."""

    robot: str
    leg: str
    repeats: int
    loads_kg: tuple[float, ...]
    stall_nm: float  #: of the data sheet
    stall_at_nm: float  #: of the drive at the voltage measured
    courses: tuple[Course, ...]
    weighings: tuple[Weighing, ...]  #: a recording each, where it can be weighed
    others_shut_down: tuple[str, ...]  #: joints of the other two supporting legs that shut down

    def of(self, part: str, load_kg: float) -> list[Course]:
        """Courses of one joint (``"femur"``) at one load, a repeat each."""
        joint = f"{self.leg}.{part}"
        return [c for c in self.courses if c.joint == joint and c.load_kg == load_kg]

    def rmse_of_stall(self, part: str, load_kg: float, *, past_friction: bool = False) -> float:
        """RMS of recovered minus true torque until a shutdown, in stall torques; NaN if unknown."""
        every = [
            ((c.past_friction_nm if past_friction else c.torque_nm) - c.true_nm)[c.before]
            for c in self.of(part, load_kg)
        ]
        return rms(np.concatenate(every)) / self.stall_nm

    def peak_of_stall(self, part: str, load_kg: float, *, true: bool = False) -> float:
        """Largest torque on average over repeats, in stall torques; true or recovered."""
        peaks = [
            np.max(np.abs((c.true_nm if true else c.torque_nm)[c.before]))
            for c in self.of(part, load_kg)
        ]
        return float(np.mean(peaks)) / self.stall_nm

    def shut_down(self, load_kg: float) -> int:
        """In how many repeats at one load the femur shut down."""
        return sum(not math.isnan(c.shut_down_s) for c in self.of("femur", load_kg))

    def weighed(self, load_kg: float) -> list[Weighing]:
        """Weighings at one load, a repeat each."""
        return [w for w in self.weighings if w.true_load_kg == load_kg]

    def recovered_kg(self, load_kg: float, how: str) -> float:
        """The load by torques told in one way (:data:`.weighing.DUTY`, ...): mean over repeats."""
        return float(np.mean([w.mean_kg(how) for w in self.weighed(load_kg)]))

    def numbers(self) -> dict[str, Any]:
        """All numbers, as JSON can hold them."""
        table = []
        for load_kg in self.loads_kg:
            joints = {}
            for part in PARTS:
                cuts = [c.shut_down_s for c in self.of(part, load_kg)]
                cuts = [cut for cut in cuts if not math.isnan(cut)]
                joints[part] = {
                    "rmse_of_stall": self.rmse_of_stall(part, load_kg),
                    "rmse_past_friction_of_stall": self.rmse_of_stall(
                        part, load_kg, past_friction=True
                    ),
                    "peak_of_stall": self.peak_of_stall(part, load_kg),
                    "true_peak_of_stall": self.peak_of_stall(part, load_kg, true=True),
                    "repeats_shut_down": len(cuts),
                    "shut_down_after_s": float(np.mean(cuts)) if cuts else None,
                }
            table.append({"load_kg": load_kg, "joints": joints})
        return {
            "leg": self.leg,
            "repeats": self.repeats,
            "stall_torque_nm": self.stall_nm,
            "stall_torque_at_supply_nm": self.stall_at_nm,
            "loads": table,
            "weighing": [self._weighing(kg) for kg in self.loads_kg if self.weighed(kg)],
            "others_shut_down": list(self.others_shut_down),
        }

    def _weighing(self, load_kg: float) -> dict[str, Any]:
        """The load recovered, beside the true one."""
        every = self.weighed(load_kg)
        return {
            "true_load_kg": load_kg,
            "own_mass_kg": every[0].own_kg,
            "repeats": len(every),
            "load": {
                how: {
                    "recovered_kg": self.recovered_kg(load_kg, how),
                    "error_kg": self.recovered_kg(load_kg, how) - load_kg,
                    "between_repeats_kg": float(np.std([w.mean_kg(how) for w in every])),
                }
                for how in every[0].load_kg
            },
            "rmse_of_stall": {
                how: {
                    joint: float(np.mean([w.rmse_nm[how][joint] for w in every])) / self.stall_nm
                    for joint in every[0].rmse_nm[how]
                }
                for how in (DUTY, PAST_FRICTION)
            },
        }

    def comparisons(self) -> tuple[Comparison, ...]:
        """Numbers beside the thesis's."""
        found = []
        moved = ("femur", "tibia")  # the coxa carries nothing here
        for past_friction, how in ((False, "duty x stall"), (True, "and friction by last motion")):
            errors = [
                self.rmse_of_stall(part, kg, past_friction=past_friction)
                for part in moved
                for kg in self.loads_kg
            ]
            if any(math.isnan(error) for error in errors):
                continue
            found.append(
                Comparison(
                    f"RMSE of femur and tibia torque ({how})",
                    f"{min(errors):.3f} to {max(errors):.3f} x stall",
                    f"{THESIS_RMSE.get(self.robot, '(another robot)')} x stall",
                    "ours is position error against the true torque of the same robot, the "
                    f"thesis's is model against real robot; {RAW_DATA}",
                )
            )
        cut = [kg for kg in self.loads_kg if self.shut_down(kg)]
        found.append(
            Comparison(
                "femur over its stall torque",
                "shuts down at " + ", ".join(f"+{kg:.3f} kg" for kg in cut) if cut else "never",
                "loaded robots: servos shut down, a plateau",
            )
        )
        return tuple(found)

    def findings(self) -> tuple[str, ...]:
        """What a reader should know."""
        found = []
        for kg in self.loads_kg:
            peak_nm = self.peak_of_stall("femur", kg) * self.stall_nm
            cuts = self.shut_down(kg)
            what = f"shut down in {cuts} of {self.repeats} repeats" if cuts else "did not shut down"
            found.append(
                f"+{kg:.3f} kg: femur of {self.leg} to {peak_nm:.3f} N m, "
                f"{peak_nm / self.stall_at_nm:.0%} of the stall torque at its voltage; it {what}"
            )
        for kg in self.loads_kg:
            if self.weighed(kg):
                weighed_kg = self.recovered_kg(kg, PAST_FRICTION)
                found.append(
                    f"+{kg:.3f} kg on the trunk: {weighed_kg:+.3f} kg by what three feet carry, "
                    f"from joint data alone; {(weighed_kg - kg) * 1e3:+.0f} g off"
                )
        if self.others_shut_down:
            found.append(f"shut down as well: {', '.join(self.others_shut_down)}")
        return tuple(found)
