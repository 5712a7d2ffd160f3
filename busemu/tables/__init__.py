"""Control tables and robot files: what is known of the devices on a bus, as data."""

from .control_table import ControlTable, Register, TableError, load_table, models, parse_table
from .robots import Robot, RobotError, ServoMount, load_robot, parse_robot, robots

__all__ = [
    "ControlTable",
    "Register",
    "Robot",
    "RobotError",
    "ServoMount",
    "TableError",
    "load_robot",
    "load_table",
    "models",
    "parse_robot",
    "parse_table",
    "robots",
]
