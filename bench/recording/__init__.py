"""Recordings: decoded bus logs, the one format in which all tools here exchange measurements."""

from .accesses import Access
from .describe import describe
from .errors import RecordingError
from .files import check_path, read, write
from .joints import JointTrack, joint_track
from .oddities import Gap, Oddities, Oddity, Weight, gaps, oddities
from .recorder import Recorder
from .recording import Recording, Series

__all__ = [
    "Access",
    "Gap",
    "JointTrack",
    "Oddities",
    "Oddity",
    "Recorder",
    "Recording",
    "RecordingError",
    "Series",
    "Weight",
    "check_path",
    "describe",
    "gaps",
    "joint_track",
    "oddities",
    "read",
    "write",
]
