"""Control tables and robot files: what is known of the devices on a bus, as data."""

from .control_table import ControlTable, load_table, models, parse_table
from .inherit import TableError
from .markdown import table_markdown
from .register import Register
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
    "table_markdown",
]
