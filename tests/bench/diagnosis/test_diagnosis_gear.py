"""Which gear is believed in: recordings of a rigid one, and of the spring of the robot file."""

import pytest
from pendulum_logs import JOINT, logs, robot

from bench.diagnosis.gear import believed
from bench.diagnosis.observed import observe
from sim.model import read_model


@pytest.mark.parametrize("sprung", [False, True], ids=["rigid", "a spring"])
def test_the_gear_that_recordings_follow_is_believed(sprung):
    told = observe(logs(motions=("fast", "steps"), sprung=sprung), robot(), JOINT)
    model, before = believed(read_model(robot()), robot(), told)
    assert model.sprung == sprung
    assert model.of(told).sprung == sprung
    assert len(before.z) == len(model.nuisances)
