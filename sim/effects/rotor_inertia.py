"""Rotor inertia: as a factor on what the robot file says."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="rotor_inertia",
    group=Group.GEAR,
    scope=Scope.JOINT,
    enters="drive",
    equation="J of the rotor at the output = scale x J of the base",
    source="reflected inertia, gear ratio squared times the rotor",
    parameters=(
        Parameter(
            "scale",
            "(ratio)",
            0.02,
            50.0,
            typical=2.0,
            off=1.0,
            source="rotors of 2 to 10 mm across; assumed",
        ),
    ),
    change=on_drives(
        lambda d, v: replace(d, rotor_inertia_kg_m2=d.rotor_inertia_kg_m2 * v["scale"])
    ),
)
