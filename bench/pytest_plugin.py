"""pytest: the fixtures ``servo_bus`` and ``faults``, for tests of a robot's own code.

It comes with the package and is there in every test::

    def test_the_elbow_goes_where_it_is_told(servo_bus):
        bus = servo_bus(model="XL430-W250", ids=[1, 2])
        my_arm.bend_elbow(bus.port, 2.0)                    # the code under test
        bus.run(1.0)                                        # virtual time: takes no time
        assert bus.servo(2).state.position_rad == pytest.approx(2.0, abs=0.01)

``servo_bus`` makes buses (:class:`bench.testing.ServoBusMaker` says of what); they are gone when
the test is over. They run in virtual time, in process, for code on dynamixel_sdk. With
``wall=True``, with the mark ``busemu_wall`` or with ``pytest --busemu-wall`` they are
pseudo-terminals in wall-clock time, for programs that open ``bus.path``.

``faults`` lets things go wrong on it: ``faults.drop(servo=2, count=3)``.

Nothing but pytest is imported until a test asks for a bus.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from .testing import BusFaults, ServoBusMaker

WALL_MARK = "busemu_wall"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what the command line may decide where a test does not."""
    group = parser.getgroup("busemu", "emulated servo buses (fixture servo_bus)")
    group.addoption(
        "--busemu-wall",
        action="store_true",
        help="pseudo-terminals in wall-clock time where a test does not ask for virtual time",
    )
    group.addoption(
        "--busemu-plant",
        metavar="PLANT",
        help="what moves the joints where a test does not say: ideal (the default) or bullet",
    )
    group.addoption(
        "--busemu-timing",
        metavar="PROFILE",
        help="timing profile, by name or path, where a test does not say; default: the robot's",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Make the mark known, also under --strict-markers."""
    config.addinivalue_line(
        "markers",
        f"{WALL_MARK}: servo buses of this test are pseudo-terminals in wall-clock time",
    )
    timing, plant = config.getoption("--busemu-timing"), config.getoption("--busemu-plant")
    if timing is not None or plant is not None:
        _check(timing, plant)


def _check(timing: str | None, plant: str | None) -> None:
    """Refuse a profile or a plant that there is not, before any test runs."""
    from busemu.assemble import plants  # noqa: PLC0415 - not before somebody asks for it
    from busemu.timing import ProfileError, load_profile  # noqa: PLC0415 - the same

    try:
        if timing is not None:
            load_profile(timing)
    except ProfileError as error:
        raise pytest.UsageError(f"--busemu-timing: {error}") from None
    if plant is not None and plant not in plants():
        raise pytest.UsageError(f"--busemu-plant: {plant!r} is none of {', '.join(plants())}")


@pytest.fixture
def servo_bus(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[ServoBusMaker]:
    """Make emulated servo buses: ``servo_bus("marvin")``, ``servo_bus(model="XL-320", ids=[1])``.

    A bus has ``port`` (for dynamixel_sdk), ``path`` (of its device, in wall-clock time), ``run``,
    and for assertions ``servo(3).register("goal_position")``, ``servo(3).state``,
    ``position_rad("leg1.tibia")``, ``counts`` and ``observe()``.
    """
    from .testing import ServoBusMaker  # noqa: PLC0415 - not before a test asks for it

    option = request.config.getoption
    maker = ServoBusMaker(
        folder=lambda: tmp_path_factory.mktemp("servo_bus"),
        wall=bool(option("--busemu-wall"))
        or request.node.get_closest_marker(WALL_MARK) is not None,
        plant=option("--busemu-plant"),
        timing=option("--busemu-timing"),
    )
    try:
        yield maker
    finally:
        maker.close()


@pytest.fixture
def faults(servo_bus: ServoBusMaker) -> BusFaults:
    """Let things go wrong on the test's bus: ``faults.drop(servo=3, count=2)``.

    With several buses, use ``bus.faults`` of each.
    """
    from .testing import BusFaults  # noqa: PLC0415 - not before a test asks for it

    return BusFaults(lambda **asked: servo_bus.the_bus().ask("fault", **asked))
