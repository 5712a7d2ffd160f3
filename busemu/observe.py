"""What an observer beside the robot saw, as a recording: ``NAME.csv`` with ``NAME.toml``.

Rows go to a file without a name, which gets its name only when it is whole. A killed server leaves
nothing.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from .plant import Plant
from .tables import Robot

COLUMNS = ("t_s", "t_reply_s", "servo_id", "op", "register", "raw")


class ObservationError(ValueError):
    """An observation file that cannot be written: says why and what to do."""


class Observation:
    """Writes :meth:`Plant.observe` at chosen instants; one row a name, ``servo_id`` 0, SI."""

    def __init__(self, path: Path, robot: Robot, plant: Plant) -> None:
        if path.suffix != ".csv":
            raise ObservationError(f"--observe {path}: the name must end in .csv")
        try:
            descriptor = os.open(path.parent, os.O_TMPFILE | os.O_WRONLY, 0o644)
        except OSError as error:
            raise ObservationError(f"--observe {path}: {error.strerror}") from None
        self._path = path
        self._plant = plant
        self._robot = robot
        self._file = os.fdopen(descriptor, "w", encoding="utf-8", newline="\n")
        self._file.write(",".join(COLUMNS) + "\n")

    def row(self, now_s: float) -> None:
        """Note what is to be seen at ``now_s`` [s, the bus's clock]."""
        for name, value in self._plant.observe().items():
            self._file.write(f"{now_s!r},{now_s!r},0,read,{name},{value!r}\n")

    def close(self) -> None:
        """Give the finished file its name, after its metadata has one."""
        self._file.flush()
        metadata = self._path.with_suffix(".toml")
        partial = metadata.with_suffix(f".toml.{os.getpid()}")
        partial.write_text(
            'format = "busemu-recording/1"\n'
            f'name = "{self._path.stem}"\n'
            f'robot = "{self._robot.name}"\n'
            'source = "simulation"\n'
            'group = "observation"\n',
            "utf-8",
        )
        partial.replace(metadata)
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()
        # With a folder's descriptor Python calls linkat(), which follows /proc's symlink.
        folder = os.open(self._path.parent, os.O_RDONLY)
        nameless = f"/proc/self/fd/{self._file.fileno()}"
        os.link(nameless, self._path, src_dir_fd=folder, follow_symlinks=True)
        os.close(folder)
        self._file.close()
