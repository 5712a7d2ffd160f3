"""What a recording's ``[condition]`` changes in a robot: its payload and its supply."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from .entries import PhysicsError
from .tree import Payload, PhysicalRobot, Supply

_WORDS = {  # word: unit, lowest, highest
    "payload_kg": ("kg", 0.0, 20.0),
    "payload_at_m": ("m", 0.0, 2.0),
    "payload_inertia_kg_m2": ("kg m^2", 0.0, 10.0),
    "supply_v": ("V", 1.0, 50.0),
}


def under(robot: PhysicalRobot, condition: Mapping[str, Any]) -> PhysicalRobot:
    """The robot as it was when something was recorded.

    ``payload_kg`` and ``payload_inertia_kg_m2`` replace those of ``[payload]``; ``payload_at_m`` is
    the weight's distance from the axis of the joint that carries it, in the direction of the file's
    place. ``supply_v`` is the voltage the operator typed in. Other words say nothing here. Raises
    :class:`sim.entries.PhysicsError` for a value that cannot be true, or a weight on a robot that
    has no ``[payload]``.
    """
    said = {word: _number(word, condition[word]) for word in _WORDS if word in condition}
    if "supply_v" in said:
        supply = Supply(said["supply_v"], robot.supply.resistance_ohm)
        robot = replace(robot, supply=supply)
    if not any(word.startswith("payload") for word in said):
        return robot
    payload = robot.payload
    if payload is None:
        if not said.get("payload_kg", 0.0):
            return robot
        raise PhysicsError(
            f"[condition] payload_kg = {said['payload_kg']:g} kg: {robot.name} has no [payload] "
            "that says where a weight is fixed"
        )
    return replace(robot, payload=_replaced(robot.name, payload, said))


def _replaced(name: str, payload: Payload, said: Mapping[str, float]) -> Payload:
    x, y, z = payload.at_m
    if "payload_at_m" in said:
        length = math.hypot(x, y, z)
        if length == 0.0:
            raise PhysicsError(
                f"[condition] payload_at_m: {name} has its [payload] at the joint itself, which "
                "gives no direction"
            )
        x, y, z = (c / length * said["payload_at_m"] for c in (x, y, z))
    return replace(
        payload,
        at_m=(x, y, z),
        mass_kg=said.get("payload_kg", payload.mass_kg),
        inertia_kg_m2=said.get("payload_inertia_kg_m2", payload.inertia_kg_m2),
    )


def _number(word: str, value: Any) -> float:
    unit, low, high = _WORDS[word]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PhysicsError(f"[condition] {word} must be a number in {unit}, not {value!r}")
    if not math.isfinite(value) or not low <= value <= high:
        raise PhysicsError(
            f"[condition] {word} = {value} {unit} is not within {low:g} to {high:g} {unit}"
        )
    return float(value)
