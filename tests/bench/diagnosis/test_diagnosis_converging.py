"""A fit of tolerances alone ends where they are likeliest, not on its way there."""

import numpy as np
import pytest
from pendulum_logs import logs, model_of

from bench.diagnosis.joint import fit as fitting
from bench.diagnosis.joint.fit import NUISANCE_LONG, NUISANCE_RANGE, Around, fit
from bench.diagnosis.joint.model import Hypothesis

ALONE = Hypothesis()
TRUTH = {
    "torque_constant": {"scale": 0.85},
    "viscous_friction": {"more_nm_s_rad": 0.02},
    "presliding": {"breakaway_rad": 4e-4},
}


@pytest.fixture(scope="module")
def model():
    """A weak motor with much friction, which is within its tolerances in turns."""
    return model_of(logs(TRUTH, motions=("fast", "steps")))


def believed(model):
    return np.zeros(len(model.nuisances))


def test_steps_over_bends_leave_a_fit_on_its_way(model, monkeypatch):
    found = fit(model, ALONE, believed(model))
    monkeypatch.setattr(fitting, "NUISANCE_RANGE", np.inf)
    assert found.cost < fit(model, ALONE, believed(model)).cost - 10.0


def test_steps_that_are_long_in_noise_are_shortened(model, monkeypatch):
    found = fit(model, ALONE, believed(model))
    size, change = Around(model, ALONE, found.z, found.noise).forward()
    length = np.linalg.norm(change, axis=0)
    assert length.max() < 2.0 * NUISANCE_RANGE
    monkeypatch.setattr(fitting, "NUISANCE_RANGE", np.inf)
    usual, far = Around(model, ALONE, found.z, found.noise).forward()
    farther = np.linalg.norm(far, axis=0)
    longest = int(np.argmax(farther))
    assert farther[longest] > 2.0 * NUISANCE_RANGE
    assert abs(size[longest]) == pytest.approx(
        abs(usual[longest]) * NUISANCE_LONG / farther[longest], rel=1e-6
    )
