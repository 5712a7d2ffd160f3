"""Effects that data of joints cannot tell apart, whatever is done with them.

Only what follows from the equations stands here; what merely looks alike does not. Reasons and use
stand in docs/proof/rules.md.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sight:
    """What the data of a case can show at all."""

    position_only: bool  #: neither duty, load nor voltage register was read
    upright: bool  #: the shaft is vertical: gravity does no work
    all_feet: bool = False  #: a robot walks, and what is hidden is in all legs alike
    no_duty: bool = False  #: neither duty nor load register was read; a voltage may have been
    legs: bool = False  #: of a whole robot on its legs, not of one joint


@dataclass(frozen=True, slots=True)
class Alike:
    """Effects that are one under a condition, and why."""

    effects: frozenset[str]
    reason: str
    position_only: bool = False  #: holds only where nothing but positions was read
    upright: bool = False  #: holds only on a vertical shaft
    all_feet: bool = False  #: holds only of all feet of a robot that walks
    no_duty: bool = False  #: holds only where neither duty nor load was read
    one_joint: bool = False  #: holds only of one joint: the trunk's centre is in no joint

    def holds(self, sight: Sight) -> bool:
        """Whether the data cannot tell them apart."""
        return (
            (sight.position_only or not self.position_only)
            and (sight.upright or not self.upright)
            and (sight.all_feet or not self.all_feet)
            and not (sight.legs and self.one_joint)
            and (sight.no_duty or sight.position_only or not self.no_duty)
        )


ALIKE = (
    Alike(
        frozenset({"dead_zone", "punch"}),
        "duty = punch + gain (error - margin): both shift the same line",
    ),
    Alike(
        frozenset({"com_offset", "zero_offset"}),
        "both turn the phase of gravity against the shown angle",
        one_joint=True,
    ),
    Alike(
        frozenset({"transport_delay", "read_skew"}),
        "a goal that acts late and a position that is shown late are one shift of time",
        no_duty=True,
    ),
    Alike(
        frozenset({"gain_error", "supply_voltage", "torque_constant"}),
        "each scales the torque for an error; below full duty nothing else",
        position_only=True,
    ),
    Alike(
        frozenset({"gain_error", "torque_constant"}),
        "each scales the torque for an error, and none the voltage",
        no_duty=True,
    ),
    Alike(
        frozenset({"torque_limit", "voltage_sag"}),
        "torque is lost where the duty is high",
        position_only=True,
    ),
    Alike(
        frozenset({"link_mass", "payload", "rotor_inertia"}),
        "without gravity each is nothing but inertia",
        upright=True,
    ),
    Alike(
        frozenset({"load_friction", "directional_load_friction"}),
        "without gravity no torque comes from outside, and that of the motor alone counts in both",
        upright=True,
    ),
    Alike(
        frozenset({"foot_compliance", "ground_compliance"}),
        "springs in series under every foot: joints see their sum",
        all_feet=True,
    ),
)


def same(effect: str, sight: Sight) -> frozenset[str]:
    """An effect and all that are one with it in such data."""
    found = {effect}
    for alike in ALIKE:
        if effect in alike.effects and alike.holds(sight):
            found |= alike.effects
    return frozenset(found)
