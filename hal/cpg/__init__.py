"""Central pattern generators: the rhythm of walking, and its shaping into joint angles."""

from .controller import LocomotionController
from .gait import Gait
from .network import Network, Rhythm, tripods
from .oscillator import OscillatorParameters, Oscillators
from .shaping import OutputShaping

__all__ = [
    "Gait",
    "LocomotionController",
    "Network",
    "OscillatorParameters",
    "Oscillators",
    "OutputShaping",
    "Rhythm",
    "tripods",
]
