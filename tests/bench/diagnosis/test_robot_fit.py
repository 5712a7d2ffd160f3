"""Fits of a whole robot on a model whose truth is known: linear nuisances, one bent knob."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.diagnosis.noise import Block, huber_weight
from bench.diagnosis.robot.features import RobotKind
from bench.diagnosis.robot.fit import FIRM, Sight
from bench.diagnosis.robot.nuisances import RobotNuisance

ROWS, NUISANCES = 400, 3
NOISE_RAD = 1e-3
TIMES = np.arange(ROWS) * 0.05
RANDOM = np.random.default_rng(3)
TRACES = 1e-2 * RANDOM.standard_normal((ROWS, NUISANCES))
TRACES[:, 1] += TRACES[:, 0]  # so that one stands in for the other where that may go no farther
BENT = 1e-2 * RANDOM.standard_normal(ROWS)
BOUNDS = (0.0, 4.0)
REACH = 2.0
SAME = 2  #: the nuisance that is the knob's effect without a name


class Pretended:
    """One recording: nuisances add up, the knob does it by its square root."""

    def __init__(self, nuisances, knob, noise_rad=NOISE_RAD, seed=1, least=None):
        noise = noise_rad * np.random.default_rng(seed).standard_normal(ROWS)
        self.data = TRACES @ np.asarray(nuisances) + self.effect(knob) + noise
        self.nuisances = [
            RobotNuisance(
                str(k), "", 1.0, "", reach=REACH, same=("bent",) if k == SAME else (), least=least
            )
            for k in range(NUISANCES)
        ]
        self.placed = {"bent": SimpleNamespace(knob=SimpleNamespace(bounds=BOUNDS))}
        self.motion = [0]
        self.traces = [{RobotKind.JOINTS: TRACES}]

    @staticmethod
    def effect(knob):
        return BENT * np.sqrt(max(knob, 0.0))

    def floors(self, least_rad=NOISE_RAD):
        return {RobotKind.JOINTS: NOISE_RAD}

    def recorded(self, r, kind):
        return self.data

    def residuals(self, names, z, which):
        knob = z[NUISANCES] if names else 0.0
        value = self.data - TRACES @ z[:NUISANCES] - self.effect(knob)
        return {(0, RobotKind.JOINTS): Block(TIMES, value, np.zeros(ROWS))}


def sight(model):
    return Sight(model, [0], RobotKind)


def test_nuisances_are_found_as_far_as_their_priors_let_them():
    true = np.array([0.5, -1.0, 0.0])
    found = sight(Pretended(true, 0.0)).fit()
    assert found.nuisances == pytest.approx(true, abs=0.05)
    assert len(found.knobs) == 0


def test_a_nuisance_that_goes_one_way_only_goes_no_other():
    true = np.array([0.5, -1.0, 0.0])
    found = sight(Pretended(true, 0.0, least=0.0)).fit()
    assert (found.nuisances >= 0.0).all()
    assert found.nuisances[1] == pytest.approx(0.0, abs=1e-6)


def test_a_knob_is_found_with_its_error():
    model = Pretended([0.3, 0.0, 0.0], 2.0)
    found = sight(model).fit(("bent",), np.array([0.0, 0.0, 0.0, 0.5]))
    believed, sandwich = sight(model).covariances(found)
    deviation = float(np.sqrt(believed[3, 3]))
    assert abs(found.settings[0][1] - 2.0) < 4.0 * deviation
    assert 0.3 < sandwich[3, 3] / believed[3, 3] < 3.0


def test_a_knob_stays_within_its_bounds():
    found = sight(Pretended([0.0, 0.0, 0.0], 9.0)).fit(("bent",), np.array([0.0, 0.0, 0.0, 1.0]))
    assert found.settings == (("bent", pytest.approx(BOUNDS[1])),)


def test_what_is_there_gains_and_what_is_not_does_not():
    for knob, gains in ((2.0, True), (0.0, False)):
        own = sight(Pretended([0.0, 0.0, 0.0], knob))
        base = own.fit()
        with_it = own.fit(("bent",), np.append(base.z, 0.5), base.noise)
        assert (base.cost - with_it.cost > 20.0) is gains


def test_doing_without_an_effect_gives_the_fit_that_never_had_it():
    own = sight(Pretended([0.5, 0.0, 0.0], 1.0))
    base = own.fit()
    with_it = own.fit(("bent",), np.append(base.z, 0.5))
    assert own.without(with_it, "bent").cost == pytest.approx(base.cost, abs=1.0)


def test_a_nuisance_goes_no_farther_than_it_may_and_the_others_adapt_to_that():
    found = sight(Pretended([0.5, 3.0, 0.0], 0.0)).fit()
    assert found.nuisances[1] == pytest.approx(REACH)
    free = [0, 2]
    left = Pretended([0.5, 3.0, 0.0], 0.0).data - REACH * TRACES[:, 1]
    normal = TRACES[:, free].T @ TRACES[:, free] / NOISE_RAD**2 + np.eye(2)
    alone = np.linalg.solve(normal, TRACES[:, free].T @ left / NOISE_RAD**2)
    assert found.nuisances[free] == pytest.approx(alone, abs=0.05)


def test_a_nuisance_is_idle_where_its_effect_is_named_and_costs_it_no_certainty():
    own = sight(Pretended([0.0, 0.0, 1.0], 1.0))
    found = own.fit(("bent",), np.array([0.0, 0.0, 1.0, 1.0]))
    assert found.nuisances[SAME] == 0.0
    believed, _ = own.covariances(found)
    assert believed[SAME, SAME] < 1e-6


class Repeated(Pretended):
    """Several recordings, each with a rest that no knob explains: the same one, or its own."""

    def __init__(self, knob, rests):
        super().__init__([0.0, 0.0, 0.0], knob)
        self.rests = rests
        self.motion = [0] * len(rests)
        self.traces *= len(rests)

    def residuals(self, names, z, which):
        ((_, block),) = super().residuals(names, z, which).items()
        return {
            (r, RobotKind.JOINTS): Block(TIMES, block.value + self.rests[r], np.zeros(ROWS))
            for r in which
        }


def test_what_every_recording_leaves_alike_is_not_believed_as_often_as_there_are_recordings():
    def rest(seed):
        return 3.0 * NOISE_RAD * np.random.default_rng(seed).standard_normal(ROWS)

    wide = {}
    for alike in (True, False):
        model = Repeated(2.0, [rest(0 if alike else r) for r in range(4)])
        own = Sight(model, range(4), RobotKind)
        found = own.fit(("bent",), np.array([0.0, 0.0, 0.0, 2.0]))
        wide[alike] = own.inflation(found, "bent")
    assert wide[True] > 2.0 * wide[False]


def test_a_knob_that_is_known_from_elsewhere_is_held_and_nuisances_fit_beside_it():
    true = np.array([0.5, -1.0, 0.0])
    own = sight(Pretended(true, 2.0))
    own.held["bent"] = 2.0
    found = own.fit(("bent",), np.array([0.0, 0.0, 0.0, 0.5]))
    assert found.settings == (("bent", 2.0),)
    assert found.nuisances == pytest.approx(true, abs=0.05)
    believed, _ = own.covariances(found)
    assert believed[3, 3] < 1e-6


def test_priors_hold_tolerances_by_as_much_as_they_count(monkeypatch):
    seen = sight(Pretended([1.5, 0.0, 0.0], 0.0, noise_rad=0.1))
    plain = seen.fit()
    monkeypatch.setattr("bench.diagnosis.robot.fit.FIRM", 25.0 * FIRM)
    firm = seen.fit()
    assert np.sum(firm.z**2) < 0.5 * np.sum(plain.z**2)
    residual, jacobian = seen.linearised((), firm.z, firm.noise)
    likelihood = jacobian.T @ (huber_weight(residual) * residual)
    balance = pytest.approx(-25.0 * FIRM * firm.z, rel=0.02)
    assert likelihood == balance, "data and priors are at balance"
    told = seen.at(firm).cost
    monkeypatch.undo()
    as_usual = seen.at(firm)
    assert told - as_usual.cost == pytest.approx(0.5 * 24.0 * FIRM * np.sum(firm.z**2))
    assert as_usual.cost > plain.cost


@pytest.mark.parametrize(("noise_rad", "low", "high"), [(1.0, 0.95, 1.02), (1e-3, 0.0, 0.01)])
def test_a_number_that_nothing_shows_is_as_unsure_as_its_prior_has_it(noise_rad, low, high):
    """However often priors count where fits are made."""
    seen = sight(Pretended([0.0, 0.0, 0.0], 0.0, noise_rad))
    _, shown = seen.covariances(seen.fit())
    assert low < shown[0, 0] < high
