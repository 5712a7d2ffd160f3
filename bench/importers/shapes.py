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
    recognises: Callable[[str], bool]  #: by the first 64 KiB of a file
    read: Callable[[Path], list[Recording]]


#: formats by name, in the order in which a file is tried
FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        module.NAME: Format(module.NAME, module.recognises, module.read)
        for module in (bam, control_state, dynaban, telemetry)
    }
    | {wide_csv.NAME: Format(wide_csv.NAME, lambda head: False, wide_csv.read)}
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
            raise RecordingError(path, _unknown(path))
        return found
    if name not in FORMATS:
        raise RecordingError(path, f"no format {name!r}: use auto or one of {', '.join(FORMATS)}")
    return FORMATS[name]


def _unknown(path: Path) -> str:
    if not head(path):
        return "the file is empty"
    if path.suffix == ".parquet":
        return "none of the known formats: a .parquet is no foreign log; look with busemu inspect"
    return (
        f"none of the known formats: say what its columns are in {wide_csv.map_beside(path).name} "
        "beside it, or see busemu import --help"
    )
