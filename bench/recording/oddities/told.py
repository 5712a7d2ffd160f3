"""Oddities of what the metadata tells: loads no servo can hold, mixed units, notes of an import."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..columns import numbers
from ..recording import Recording
from .oddity import Oddity, Weight, first_rows

GRAVITY = 9.81  #: m/s^2
#: longest arm on a servo [m], heaviest weight [kg]; assumed
LONGEST_M, HEAVIEST_KG = 2.0, 20.0
#: a weight of unknown distance pulls at least at this [m]; assumed: the horn's own radius
HORN_M = 0.01
#: an angle in a channel called rad beyond this is taken for degrees [rad]
DEGREES_RAD = 20.0
#: a length in a channel called m beyond this is taken for millimetres [m]
MILLIMETRES_M = 20.0
IMPORT_WHY = "the importer had to decide; another decision gives other numbers"


def check(recording: Recording) -> Iterator[Oddity]:
    """All that is odd about what the metadata tells."""
    metadata = recording.metadata
    condition = metadata.get("condition", {})
    if isinstance(condition, Mapping):
        yield from _condition(recording, condition)
    imported = metadata.get("import", {})
    notes = imported.get("notes", []) if isinstance(imported, Mapping) else []
    for note in notes if isinstance(notes, list) else []:
        yield _imported(str(note))
    if recording.robot is None:
        name = metadata.get("robot")
        yield Oddity(
            "no_robot",
            Weight.NOTE,
            "no robot is named" if name is None else f"the robot {name!r} is not known here",
            "there are no joints, masses and drives to compare with",
            "name one: --robot, or robot = ... in the metadata",
        )
    yield from _units(recording)


def _imported(note: str) -> Oddity:
    if note.startswith("unsorted times"):
        return Oddity(
            "shuffled_rows",
            Weight.WARNING,
            note,
            "rows out of order, or a clock that was set back: the second makes sorting wrong",
            "look at the rows named; log a monotonic clock",
        )
    return Oddity("import", Weight.NOTE, note, IMPORT_WHY, "heed it when times or units matter")


def _condition(recording: Recording, condition: Mapping[str, Any]) -> Iterator[Oddity]:
    numbers_told = {
        word: float(value)
        for word, value in condition.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
    for word in ("payload_kg", "payload_at_m", "supply_v", "payload_inertia_kg_m2", "arm_mass_kg"):
        if word in condition and (
            word not in numbers_told or not 0.0 <= numbers_told[word] < np.inf
        ):
            yield _impossible(
                word, f"{word} = {condition[word]!r} is no such quantity", "correct it"
            )
    length, mass = numbers_told.get("payload_at_m"), numbers_told.get("payload_kg")
    if length is not None and length > LONGEST_M:
        yield _impossible(
            "payload_at_m",
            f"an arm of {length:g} m",
            f"if it is in millimetres, write {length * 1e-3:g}; in centimetres, {length * 1e-2:g}",
        )
    if mass is not None and mass > HEAVIEST_KG:
        yield _impossible(
            "payload_kg", f"a weight of {mass:g} kg", f"if it is in grams, write {mass * 1e-3:g}"
        )
    if mass is not None:
        yield from _too_heavy(recording, mass, HORN_M if length is None else length)
    if (volts := numbers_told.get("supply_v")) is not None:
        yield from _voltage(recording, volts)


def _too_heavy(recording: Recording, mass_kg: float, length_m: float) -> Iterator[Oddity]:
    drives = {} if recording.robot is None else recording.robot.document.get("drive", {})
    torques = [
        float(drive["stall_torque_nm"]["value"])
        for model in {table.model for table in recording.models.values()}
        if isinstance(drive := drives.get(model), Mapping) and "stall_torque_nm" in drive
    ]
    wanted = mass_kg * GRAVITY * length_m
    if torques and wanted > 3.0 * max(torques):
        yield _impossible(
            "payload_kg",
            f"{mass_kg:g} kg at {length_m:g} m need {wanted:.3g} N m, the servo stalls at "
            f"{max(torques):g} N m",
            "check the units: grams, millimetres?",
        )


def _voltage(recording: Recording, volts: float) -> Iterator[Oddity]:
    for table in {table.model: table for table in recording.models.values()}.values():
        if "max_voltage_limit" not in table:
            continue
        top = table["max_voltage_limit"].si_scale * table["max_voltage_limit"].maximum
        low = table["min_voltage_limit"].si_scale * table["min_voltage_limit"].minimum
        if volts > 1.2 * top or volts < 0.8 * low:
            yield _impossible(
                "supply_v",
                f"{volts:g} V on a {table.model}, which takes {low:g} to {top:g} V",
                "check the unit: millivolts, or a tenth of a volt a count?",
            )


def _impossible(word: str, what: str, advice: str) -> Oddity:
    return Oddity(
        "impossible_metadata",
        Weight.SERIOUS,
        f"{word}: {what}" if not what.startswith(word) else what,
        "a model of this rig moves in no way like the recording",
        advice,
    )


def _units(recording: Recording) -> Iterator[Oddity]:
    """Namespaced values that cannot be in the unit of their name."""
    raw = numbers(recording.table, "raw")
    for (_, name, _), rows in recording.by_series.items():
        limit, unit, other = {
            "rad": (DEGREES_RAD, "rad", "degrees"),
            "m": (MILLIMETRES_M, "m", "millimetres"),
        }.get(name.rpartition("_")[2], (np.inf, "", ""))
        values = np.abs(raw[rows])
        values = values[~np.isnan(values)]
        if "/" not in name or not values.size:
            continue
        if float(np.median(values)) > limit:
            yield Oddity(
                "unit_mix_up",
                Weight.SERIOUS,
                f"values of about {np.median(values):.4g} {unit}: {other}?",
                "such a channel is far off whatever it is compared with",
                f"convert it, or name it without _{unit}",
                register=name,
                rows=first_rows(rows),
                count=len(rows),
            )
