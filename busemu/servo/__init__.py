"""A virtual servo: its memory, what instructions do to it, and when it protects itself."""

from .device import Servo
from .memory import Memory
from .status import Refusal

__all__ = ["Memory", "Refusal", "Servo"]
