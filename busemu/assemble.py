"""A bus from a robot file, a plant and a timing profile."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

from .bus import Bus
from .plant import Plant, reading_of
from .servo import Servo
from .tables import Robot, RobotError
from .timing import Profile
from .trace import WireEvent

#: An adapter with a timer hands up so many bytes before it runs out. Source: FTDI, packets of 64
#: bytes with two of status.
CHUNK_BYTES = 62


def assemble(
    robot: Robot,
    plant: Plant,
    profile: Profile,
    *,
    start_s: float = 0.0,
    on_wire: Callable[[WireEvent], None] | None = None,
) -> Bus:
    """The bus of ``robot``, its servos moving the joints of ``plant``.

    ``start_s`` is the clock's reading [s] at the plant's time zero. What the plant says of its
    adapter comes on top of the profile.
    """
    if held_s := reading_of(plant).latency_timer_s:
        profile = replace(
            profile,
            latency_timer_s=profile.latency_timer_s + held_s,
            chunk_bytes=profile.chunk_bytes or CHUNK_BYTES,
        )
    for table in robot.tables.values():
        if not table.drive:
            raise RobotError(
                f"{robot.path}: {table.path} has no [drive], so it says what is on a bus and not "
                "what a servo does: give it one, or extend a model (docs/reference/tables.md)"
            )
    try:
        servos = [
            Servo(
                mount,
                robot.tables[mount.servo_id],
                plant,
                robot.baud_rate,
                eeprom_byte_s=profile.eeprom_byte_s,
            )
            for mount in robot.servos
        ]
    except ValueError as error:
        raise RobotError(f"{robot.path}: [bus] baud_rate: {error}") from None
    return Bus(
        servos,
        plant,
        profile,
        protocol=robot.protocol,
        baud_rate=robot.baud_rate,
        start_s=start_s,
        on_wire=on_wire,
    )


def plants() -> dict[str, Callable[..., Plant]]:
    """Installed plants by name (entry-point group ``busemu.plants``), not yet imported.

    Called with a robot and, where wanted, ``world``: the file of what is around it. Raises
    :class:`RobotError` for a plant that has no world.
    """

    def lazily(name: str) -> Callable[..., Plant]:
        def make(robot: Robot, world: Path | None = None) -> Plant:
            (entry,) = entry_points(group="busemu.plants", name=name)
            maker = entry.load()
            options: dict[str, Path] = {}
            if world is not None:
                if "world" not in inspect.signature(maker).parameters:
                    raise RobotError(f"plant {name} knows no world: leave --world off")
                options["world"] = world
            plant: Plant = maker(robot, **options)
            return plant

        return make

    names = sorted({entry.name for entry in entry_points(group="busemu.plants")})
    return {name: lazily(name) for name in names}
