"""What the operator believes: the robot file of a rig, and a recording's metadata."""

from __future__ import annotations

from typing import Any

import tomli_w

from bench.motions import ExperimentPlan

from .rigs import Rig
from .servos import Sheet
from .specimen import Vector

SERVO_ID = 1
JOINT = "arm"


def _said(value: Any, source: str) -> dict[str, Any]:
    return {"value": value, "source": source}


def robot_document(rig: Rig) -> dict[str, Any]:
    """The robot file of a rig with nominal values, format ``busemu-robot/1``."""
    sheet, arm = rig.sheet, rig.arm
    drawing = "drawing and scales"
    return {
        "format": "busemu-robot/1",
        "name": rig.name,
        "title": rig.title,
        "bus": {
            "protocol": sheet.table.protocol,
            "baud_rate": 1_000_000,
            "servo_model": sheet.model,
            "timing": "ideal",
        },
        "supply": {
            "voltage_v": _said(sheet.rated_voltage_v, "typed in by the operator"),
            "resistance_ohm": _said(0.0, "not measured"),
        },
        "body": [
            {
                "name": JOINT,
                "at_m": _said([0.0, 0.0, 0.0], drawing),
                "axis": _said([0.0, 0.0, 1.0] if rig.upright else [0.0, 1.0, 0.0], drawing),
                "mass_kg": _said(arm.mass_kg, drawing),
                "com_m": _said(_turned(rig, arm.com_m), drawing),
                "inertia_kg_m2": _said(_turned(rig, arm.inertia_kg_m2, signed=False), drawing),
                "lower_rad": _said(-2.0, "assumed: before the links touch"),
                "upper_rad": _said(2.0, "assumed: before the links touch"),
            }
        ],
        "payload": {
            "body": JOINT,
            "at_m": _said(_turned(rig, (0.0, 0.0, -rig.payload_at_m)), drawing),
            "mass_kg": _said(rig.payloads_kg[0], "scales"),
        },
        "servo": [
            {
                "id": SERVO_ID,
                "joint": JOINT,
                "direction": 1,
                "zero_rad": 0.0,
                "registers": dict(sheet.registers),
            }
        ],
        "drive": {sheet.model: _drive(sheet)},
    }


def _turned(rig: Rig, v: Vector, *, signed: bool = True) -> list[float]:
    """A vector of the hidden world in the file's frame; on an upright rig the arm points to +x."""
    if not rig.upright:
        return list(v)
    x, y, z = v
    turned = [-z, -x, y] if signed else [z, x, y]
    return [part + 0.0 for part in turned]  # no negative zeros


def _drive(sheet: Sheet) -> dict[str, Any]:
    data = "data sheet"
    return {
        "rated_voltage_v": _said(sheet.rated_voltage_v, data),
        "stall_torque_nm": _said(sheet.stall_torque_nm, data),
        "stall_current_a": _said(sheet.stall_current_a, data),
        "no_load_velocity_rad_s": _said(sheet.no_load_velocity_rad_s, data),
        "no_load_current_a": _said(sheet.no_load_current_a, "from the friction below"),
        "gear_ratio": _said(sheet.gear_ratio, data),
        "motor_inertia_kg_m2": _said(sheet.rotor_inertia_kg_m2, "assumed"),
        "coulomb_nm": _said(sheet.coulomb_nm, "assumed, as published fits"),
        "viscous_nm_s_rad": _said(sheet.viscous_nm_s_rad, "assumed, as published fits"),
        "gear_stiffness_nm_rad": _said(sheet.gear_stiffness_nm_rad, "assumed"),
        "gear_damping_nm_s_rad": _said(sheet.gear_damping_nm_s_rad, "assumed"),
        "backlash_rad": _said(0.0, "off"),
        "sensor_step_rad": _said(sheet.step_rad, "control table"),
        "ambient_c": _said(25.0, "assumed"),
    }


def robot_toml(rig: Rig) -> str:
    """The robot file as text."""
    return tomli_w.dumps(robot_document(rig))


def metadata(rig: Rig, plan: ExperimentPlan, name: str, group: str) -> dict[str, Any]:
    """Metadata of a recording: only what an operator would believe."""
    condition: dict[str, Any] = {
        "support": "rig",
        "supply_v": rig.sheet.rated_voltage_v,
        "payload_kg": rig.payloads_kg[0] if plan.payload_kg is None else plan.payload_kg,
        "motion": plan.motion.name,
        "warm_start_s": plan.warm_start_s,
    }
    if plan.payload_at_m is not None:
        condition["payload_at_m"] = plan.payload_at_m
    return {
        "name": name,
        "robot": "../robot.toml",
        "source": "simulation",
        "group": group,
        "condition": condition,
        "bus": {"protocol": rig.sheet.table.protocol, "baud_rate": 1_000_000},
        "servo": {
            str(SERVO_ID): {
                "model": rig.sheet.model,
                "registers": {**rig.sheet.registers, **plan.registers},
            }
        },
    }
