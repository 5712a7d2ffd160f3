from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from busemu.tables import Robot, load_robot
from sim.world import BulletPlant


@pytest.fixture(params=("marvin", "phantomx"))
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


@pytest.fixture
def make() -> Iterator[Callable[..., BulletPlant]]:
    made: list[BulletPlant] = []

    def plant(robot: Robot, **options: Any) -> BulletPlant:
        made.append(BulletPlant(robot, **options))
        return made[-1]

    yield plant
    for each in made:
        each.close()
