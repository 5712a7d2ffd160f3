"""The thesis's four experiments, run over the bus by the robot's own software.

``experiment`` (what one is), ``campaign`` (run and resume), ``report`` (what it leaves), one module
an experiment and one its result, ``figures`` (what they draw). What they share: ``motion`` (moving
a robot), ``position_error`` (torque from joint data), ``series`` (what is asked of a recording),
``gait_phase``, ``steps``, ``lines``.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from .experiment import Experiment
from .leg_step import LegStepExperiment
from .locomotion import LocomotionExperiment
from .servo_check import ServoCheckExperiment
from .torque_analysis import TorqueAnalysisExperiment

#: All experiments by name, in the thesis's order.
EXPERIMENTS: Mapping[str, Experiment[Any]] = MappingProxyType(
    {
        experiment.name: experiment
        for experiment in (
            ServoCheckExperiment(),
            TorqueAnalysisExperiment(),
            LegStepExperiment(),
            LocomotionExperiment(),
        )
    }
)

__all__ = ["EXPERIMENTS", "Experiment"]
