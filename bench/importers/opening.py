"""Recordings from paths of any kind: the project's own files, foreign ones, folders of either."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from bench.recording import Recording, RecordingError, read

from . import control_state, wide_csv
from .shapes import known_format, recognise
from .source import head, header

#: suffixes that a folder is searched for
SUFFIXES = (".parquet", ".csv", ".json", ".csv.gz", ".json.gz")


def import_file(
    path: str | Path,
    format: str = "auto",
    *,
    robot: str | None = None,
    map_path: str | Path | None = None,
) -> list[Recording]:
    """Read a foreign file as recordings.

    ``format``: one of :data:`bench.importers.FORMATS`, or ``"auto"``. ``robot``: name or path of a
    robot file, instead of the one that goes with the format. ``map_path``: what the columns of a
    wide CSV are, if no file beside it says so. Raises :class:`RecordingError` with the file, the
    row and the rule, and ``OSError``.
    """
    path = Path(path)
    if map_path is not None and format in ("auto", wide_csv.NAME):
        found = wide_csv.read(path, Path(map_path))
    else:
        found = known_format(format, path).read(path)
    return [_with_robot(recording, robot) for recording in found]


def open_recordings(paths: Iterable[str | Path], robot: str | None = None) -> list[Recording]:
    """Read recordings of any kind: own files, foreign files, folders of them.

    A pair of foreign files counts once. ``robot``: name or path of a robot file for recordings that
    name none, or none that is known here. Raises :class:`RecordingError` and ``OSError``.
    """
    return [recording for path in expanded(paths) for recording in _opened(path, robot)]


def expanded(paths: Iterable[str | Path]) -> list[Path]:
    """The files that ``paths`` stand for, each recording's once; folders are searched.

    In a folder, files of no known format are passed over; a folder without any raises
    :class:`RecordingError`.
    """
    found: dict[Path, None] = {}
    for path in map(Path, paths):
        if path.is_dir():
            inside = [p for p in sorted(path.rglob("*")) if p.name.endswith(SUFFIXES)]
            known = [p for p in inside if p.is_file() and (is_own(p) or recognise(p) is not None)]
            if not known:
                raise RecordingError(path, "no recordings in this folder")
            found.update(dict.fromkeys(map(_first_of_pair, known)))
        else:
            found[_first_of_pair(path)] = None
    return list(found)


def is_own(path: Path) -> bool:
    """Whether a file is a recording of the project's own format, by its name and header."""
    if path.suffix in (".parquet", ".toml"):
        return True
    return path.suffix == ".csv" and {"t_s", "register"} <= set(header(head(path)))


def _opened(path: Path, robot: str | None) -> Iterator[Recording]:
    if not is_own(path):
        yield from import_file(path, robot=robot)
        return
    recording = read(path)
    yield recording if recording.robot is not None else _with_robot(recording, robot)


def _with_robot(recording: Recording, robot: str | None) -> Recording:
    if robot is None or recording.metadata.get("robot") == robot:
        return recording
    metadata = recording.metadata | {"robot": robot}
    return Recording.checked(recording.table, metadata, recording.path)


def _first_of_pair(path: Path) -> Path:
    """The same path for both files of a pair."""
    if path.is_file() and path.suffix in (".csv", ".gz"):
        beginning = head(path)
        if control_state.recognises(beginning):
            return control_state.partner(path)[1]
    return path
