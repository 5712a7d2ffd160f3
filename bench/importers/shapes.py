"""The formats that are known, and which of them a file is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from bench.recording import Recording, RecordingError

from . import bam, control_state, dynaban, telemetry, wide_csv
from .source import head


@dataclass(frozen=True, slots=True)
class Format:
    """A shape of files: how it is recognised and read."""

    name: str
    what: str  #: for people: what such files hold
    recognises: Callable[[str], bool]  #: by the first 64 KiB of a file
    read: Callable[[Path], list[Recording]]


WIDE = "any CSV of one column a signal, with a map (NAME.columns.toml, or --map)"

#: formats by name, in the order in which a file is tried
FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        module.NAME: Format(module.NAME, what, module.recognises, module.read)
        for module, what in (
            (bam, "JSON logs of bam's recorder: one servo, a weight on an arm"),
            (control_state, "pairs control.csv and state_motor.csv: goals and lists of joints"),
            (dynaban, "CSV of one MX-64: duty and track, trajectories, registers, register dumps"),
            (telemetry, "CSV with a column a value and servo: pos (5), load (5), ..."),
        )
    }
    | {wide_csv.NAME: Format(wide_csv.NAME, WIDE, lambda head: False, wide_csv.read)}
)


def recognise(path: Path) -> Format | None:
    """The format of a file by its beginning, ``None`` if it is none of them.

    Raises :class:`RecordingError` for a broken gzip file and ``OSError``.
    """
    beginning = head(path)
    if wide_csv.map_beside(path).is_file():
        return FORMATS[wide_csv.NAME]
    return next((form for form in FORMATS.values() if form.recognises(beginning)), None)


def known_format(name: str, path: Path) -> Format:
    """The format called ``name``; ``auto`` looks at the file. Raises :class:`RecordingError`."""
    if name == "auto":
        found = recognise(path)
        if found is None:
            raise RecordingError(
                path,
                "none of the known formats: give --map with a file that says what its columns are, "
                f"or name one of {', '.join(FORMATS)}",
            )
        return found
    if name not in FORMATS:
        raise RecordingError(path, f"no format {name!r}: use auto or one of {', '.join(FORMATS)}")
    return FORMATS[name]
