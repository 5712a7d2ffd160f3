"""A robot's whole model: the base physics of its file, and the effects that stand in it.

An effect in a robot file, as a diagnosis writes it or by hand::

    [[effect]]
    name = "backlash"                     # of the catalogue
    where = ["leg1.tibia"]                # its joints, legs or bodies; absent: everywhere
    [effect.parameters]
    width_rad = { value = 0.011, ci95 = [0.010, 0.012], unit = "rad", source = "walk-1, walk-2" }

``ci95`` and ``unit`` may be left out; a unit must be the catalogue's. A parameter that is left out
is off.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from busemu.tables import Robot

from .condition import under
from .effects import Effect, Parameter, effect
from .entries import PhysicsError, Section
from .robot import read_physics
from .tree import PhysicalRobot


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter's value, its 95 % interval where one is known, and where it comes from."""

    value: float
    source: str
    ci95: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Addition:
    """An effect that stands in a robot file; ``where`` empty is everywhere."""

    effect: Effect
    where: tuple[str, ...]
    estimates: Mapping[str, Estimate]

    @property
    def values(self) -> dict[str, float]:
        """Every parameter; what the file leaves out is off."""
        known = {name: estimate.value for name, estimate in self.estimates.items()}
        return self.effect.off | known

    def to(self, robot: PhysicalRobot) -> PhysicalRobot:
        """The robot with the effect. Raises :class:`sim.entries.PhysicsError`."""
        return self.effect.apply(robot, self.where, self.values)


def read_model(
    robot: Robot,
    *,
    trunk_load_kg: float = 0.0,
    condition: Mapping[str, Any] | None = None,
) -> PhysicalRobot:
    """The robot of a file with its effects, under a recording's condition.

    The condition changes the base, on which the effects then act. Raises
    :class:`sim.entries.PhysicsError` with one line for what cannot be true.
    """
    model = under(read_physics(robot, trunk_load_kg=trunk_load_kg), condition or {})
    for number, addition in enumerate(additions(robot)):
        try:
            model = addition.to(model)
        except PhysicsError as error:
            raise PhysicsError(f"{robot.path}: [effect][{number}] {error}") from None
    for joint in model.joints:
        if (share := joint.drive.friction.load_motor) >= 1.0:
            raise PhysicsError(
                f"{robot.path}: {joint.name}: friction takes {share:.3g} (ratio) of the motor's "
                "torque in all, so that it never moves: 0 to below 1 (ratio) is possible; lower "
                "load_motor or the effects of load friction"
            )
    return model


def additions(robot: Robot) -> tuple[Addition, ...]:
    """The effects of a robot file, in its order. Raises :class:`sim.entries.PhysicsError`."""
    if not robot.document.get("effect"):
        return ()
    return tuple(_addition(s) for s in Section(robot.path, "", robot.document).sections("effect"))


def effect_tables(added: Iterable[Addition]) -> list[dict[str, Any]]:
    """The ``[[effect]]`` tables of a robot file, as tomli_w writes them."""
    return [
        {
            "name": addition.effect.name,
            "where": list(addition.where),
            "parameters": {
                name: _table(addition.effect.parameter(name), estimate)
                for name, estimate in addition.estimates.items()
            },
        }
        for addition in added
    ]


def with_additions(robot: Robot, added: Iterable[Addition]) -> dict[str, Any]:
    """The document of a robot file with more effects after its own."""
    document = dict(robot.document)
    document["effect"] = [*document.get("effect", []), *effect_tables(added)]
    return document


def _table(parameter: Parameter, estimate: Estimate) -> dict[str, Any]:
    table: dict[str, Any] = {"value": estimate.value}
    if estimate.ci95 is not None:
        table["ci95"] = list(estimate.ci95)
    return table | {"unit": parameter.unit, "source": estimate.source}


def _addition(section: Section) -> Addition:
    section.only("name", "where", "parameters")
    name = section.word("name")
    where = section.table.get("where", [])
    if not isinstance(where, list) or not all(isinstance(place, str) for place in where):
        raise section.fail(f"where must be a list of names of joints or legs, not {where!r}")
    entries = section.table.get("parameters", {})
    if not isinstance(entries, Mapping) or not entries:
        raise section.fail(
            "needs parameters = { name = { value = ..., source = ... } }; "
            "python -m sim.effects lists them"
        )
    try:
        kind = effect(name)
        parameters = {key: kind.parameter(key) for key in entries}
    except PhysicsError as error:
        raise section.fail(str(error)) from None
    try:
        estimates = {key: _estimate(parameters[key], entry) for key, entry in entries.items()}
    except PhysicsError as error:
        raise section.fail(f"effect {name}: {error}") from None
    return Addition(kind, tuple(where), estimates)


def _estimate(parameter: Parameter, entry: Any) -> Estimate:
    keys = {"value", "source", "ci95", "unit"}
    if not isinstance(entry, Mapping) or not {"value", "source"} <= set(entry) <= keys:
        raise PhysicsError(
            f"{parameter.name} must be {{ value = ..., source = ... }}, if you like with ci95 and "
            f"unit, not {entry!r}"
        )
    if not isinstance(entry["source"], str) or not entry["source"].strip():
        raise PhysicsError(f"{parameter.name} needs a source: recordings, or assumed")
    if entry.get("unit", parameter.unit) != parameter.unit:
        raise PhysicsError(f"{parameter.name} is in {parameter.unit}, not {entry['unit']}")
    value = _number(parameter, entry["value"])
    parameter.check(value)
    if "ci95" not in entry:
        return Estimate(value, entry["source"])
    interval = entry["ci95"]
    if not isinstance(interval, list) or len(interval) != 2:
        raise PhysicsError(f"{parameter.name} ci95 must be [low, high], not {interval!r}")
    low, high = (_number(parameter, end) for end in interval)
    if not low <= high:
        raise PhysicsError(f"{parameter.name} ci95 = {interval} {parameter.unit}: low beyond high")
    return Estimate(value, entry["source"], (low, high))


def _number(parameter: Parameter, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PhysicsError(f"{parameter.name} must be a number in {parameter.unit}, not {value!r}")
    try:
        return float(value)
    except OverflowError:  # TOML knows whole numbers of any length
        raise PhysicsError(
            f"{parameter.name} = {value!s:.40}... {parameter.unit} is not within "
            f"{parameter.low:g} to {parameter.high:g} {parameter.unit}"
        ) from None
