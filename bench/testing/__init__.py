"""Servo buses for tests of a robot's own code; ``bench.pytest_plugin`` makes them a fixture."""

from .buses import ServoBus, ServoBusError, ServoView, VirtualServoBus
from .faulting import BusFaults
from .maker import ServoBusMaker

__all__ = [
    "BusFaults",
    "ServoBus",
    "ServoBusError",
    "ServoBusMaker",
    "ServoView",
    "VirtualServoBus",
]
