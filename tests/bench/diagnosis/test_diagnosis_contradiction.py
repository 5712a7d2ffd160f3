"""A supply that the motion asks for, and what the voltage register says of it."""

import numpy as np
import pytest
from pendulum_logs import DUTY, POSITION, VOLTS, logs, model_of

from bench.diagnosis import contradiction
from bench.diagnosis.contradiction import AT_FIRST, supply_contradiction
from bench.diagnosis.fit import fit
from bench.diagnosis.model import Hypothesis

SOURCE_OHM = 3.0


@pytest.fixture(scope="module")
def sagging():
    """A supply that sags, and what is believed without it."""
    truth = {"voltage_sag": {"resistance_ohm": SOURCE_OHM}}
    model = model_of(
        logs(
            truth,
            motions=("steps", "fast", "swell"),
            registers=(POSITION, DUTY, VOLTS),
            duration_s=4.0,
        )
    )
    return model, fit(model, Hypothesis(), np.zeros(len(model.nuisances)))


def test_a_register_that_shows_the_sag_denies_nothing(sagging):
    assert supply_contradiction(*sagging, print) == ()


def test_a_fit_to_the_register_that_stops_where_it_began_denies_nothing(sagging, monkeypatch):
    """It is begun at what the motion asks for as well, and the deeper one is believed."""

    def stopping(model, hypothesis, start, noise):
        if start[-1] != AT_FIRST:
            return fit(model, hypothesis, start, noise)
        return fit(model, hypothesis, start, noise, held=[len(start) - 1])

    monkeypatch.setattr(contradiction, "fit", stopping)
    assert supply_contradiction(*sagging, print) == ()
