"""Making the bus that a test asks for, and taking all of them away at its end."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from busemu.assemble import plants
from busemu.plant import Plant
from busemu.tables import Robot, load_robot, load_table
from busemu.tables.robots import FORMAT
from busemu.timing import load_profile

from .buses import ServoBus, ServoBusError, VirtualServoBus


@dataclass(slots=True)
class ServoBusMaker:
    """Makes buses. What a test leaves open is decided by the command line, then by the defaults.

    ``folder`` is called for a folder of its own when a file has to be written.
    """

    folder: Callable[[], Path]
    wall: bool = False
    plant: str | None = None
    timing: str | None = None
    _made: list[ServoBus] = field(default_factory=list)

    def __call__(
        self,
        robot: str | Path | None = None,
        *,
        model: str | None = None,
        ids: Iterable[int] = (1,),
        baud_rate: int = 1_000_000,
        registers: Mapping[str, int] | None = None,
        plant: str | Callable[[Robot], Plant] | None = None,
        timing: str | Path | None = None,
        wall: bool | None = None,
        link: Path | None = None,
    ) -> ServoBus:
        """A bus of a robot, by name or path, or of a few servos of one ``model``.

        ``ids``, ``baud_rate`` [bit/s] and ``registers`` (raw values that every servo starts with)
        belong to ``model``; their joints are called ``servo1``, ``servo2`` after the IDs.
        ``plant`` is ``"ideal"``, ``"bullet"``, another installed one, or (in virtual time) a
        function that makes one. ``timing`` is a profile, by name or path; by default the robot's
        own. ``wall`` asks for a pseudo-terminal in wall-clock time, with a symlink to it at
        ``link`` if given.

        Raises :class:`ServoBusError`, :class:`busemu.tables.RobotError`,
        :class:`busemu.tables.TableError` or :class:`busemu.timing.ProfileError`.
        """
        if (robot is None) is (model is None):
            raise ServoBusError("name either a robot or a servo model: servo_bus('marvin')")
        if model is not None:
            robot = self._write(model, tuple(ids), baud_rate, registers or {})
        assert robot is not None
        described = load_robot(robot)
        wanted = plant or self.plant or "ideal"
        profile = timing or self.timing or described.timing
        wall = self.wall if wall is None else wall
        bus = (
            _on_a_pty(described, robot, wanted, profile, link)
            if wall
            else _in_process(described, wanted, profile, link)
        )
        self._made.append(bus)
        return bus

    def the_bus(self) -> ServoBus:
        """The bus of a test that has one; otherwise :class:`ServoBusError`."""
        if len(self._made) != 1:
            raise ServoBusError(
                "the fixture faults is for a test with one bus: "
                + ("use bus.faults" if self._made else "make it first, with servo_bus(...)")
            )
        return self._made[0]

    def close(self) -> None:
        """Take all buses away, the last one first."""
        while self._made:
            self._made.pop().close()

    def _write(
        self, model: str, ids: tuple[int, ...], baud_rate: int, registers: Mapping[str, int]
    ) -> Path:
        """A robot file of servos that hang on nothing but the bus."""
        path = self.folder() / "servos.toml"
        lines = [
            f"format = {json.dumps(FORMAT)}",
            'name = "servos"',
            "[bus]",
            f"protocol = {load_table(model).protocol}",
            f"baud_rate = {baud_rate}",
            f"servo_model = {json.dumps(model)}",
        ]
        for servo_id in ids:
            lines += ["[[servo]]", f"id = {servo_id}", f'joint = "servo{servo_id}"']
            lines += [f"registers.{name} = {raw}" for name, raw in registers.items()]
        path.write_text("\n".join(lines) + "\n", "utf-8")
        return path


def _in_process(
    robot: Robot,
    plant: str | Callable[[Robot], Plant],
    timing: str | Path,
    link: Path | None,
) -> ServoBus:
    if link is not None:
        raise ServoBusError("a bus in virtual time has no device to link to: add wall=True")
    if isinstance(plant, str):
        makers = plants()
        if plant not in makers:
            raise ServoBusError(f"no plant named {plant!r}: use one of {', '.join(makers)}")
        plant = makers[plant]
    try:
        made = plant(robot)
    except ModuleNotFoundError as error:
        raise ServoBusError(
            f"the plant needs {error.name}: pip install 'busemu[sim]', or use plant=\"ideal\""
        ) from None
    return VirtualServoBus(robot, made, load_profile(timing))


def _on_a_pty(
    robot: Robot,
    name: str | Path,
    plant: str | Callable[[Robot], Plant],
    timing: str | Path,
    link: Path | None,
) -> ServoBus:
    from .served import PtyServoBus  # noqa: PLC0415 - virtual time needs no server

    if not isinstance(plant, str):
        raise ServoBusError("a bus in wall-clock time is another process: name an installed plant")
    return PtyServoBus(robot, str(name), plant, str(timing), link)
