"""A bus from a robot file, a plant and a timing profile."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points

from .bus import Bus
from .plant import Plant
from .servo import Servo
from .tables import Robot, RobotError
from .timing import Profile
from .trace import WireEvent


def assemble(
    robot: Robot,
    plant: Plant,
    profile: Profile,
    *,
    start_s: float = 0.0,
    on_wire: Callable[[WireEvent], None] | None = None,
) -> Bus:
    """The bus of ``robot``, its servos moving the joints of ``plant``.

    ``start_s`` is the clock's reading [s] at the plant's time zero.
    """
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


def plants() -> dict[str, Callable[[Robot], Plant]]:
    """Installed plants by name (entry-point group ``busemu.plants``), not yet imported."""

    def lazily(name: str) -> Callable[[Robot], Plant]:
        def make(robot: Robot) -> Plant:
            (entry,) = entry_points(group="busemu.plants", name=name)
            plant: Plant = entry.load()(robot)
            return plant

        return make

    names = sorted({entry.name for entry in entry_points(group="busemu.plants")})
    return {name: lazily(name) for name in names}
