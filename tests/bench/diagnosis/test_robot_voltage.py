"""The voltage registers of a robot: they tell a low supply from a low gain."""

from dataclasses import replace
from functools import cache
from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest
from walking_robots import believed, but, marvin, walked, walked_by

from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.features import Features, RobotKind
from bench.diagnosis.robot.fit import Sight, voltage_noise
from bench.diagnosis.robot.limits import limits
from bench.diagnosis.robot.model import VOLTAGE_FLOOR_V, VOLTAGE_SENSE, RobotModel
from bench.diagnosis.robot.replay import LEAST_SAMPLES, course, play
from bench.running import Steering, in_process, walk_in
from busemu.tables import load_robot
from busemu.timing import load_profile
from sim.world import BulletPlant

KNOWN = but("supply", "gain", "motors")
COUNT_V = 0.1  #: of the register
LESS = 0.8  #: of what is believed


@cache
def read(name="marvin", reads=10**6):
    """A walk whose program reads the voltage of one servo a cycle, so many times."""
    robot = load_robot(name)
    plant = BulletPlant(robot)
    session = in_process(robot, plant, load_profile(robot.timing))
    ids, left = cycle(robot.by_id), iter(range(reads))

    def one(_):
        if next(left, None) is not None:
            session.client.read(next(ids), "present_voltage")

    walk_in(session, Steering(seconds=4.5), one)
    plant.close()
    return session.recording("walk-1", "walk")


def told(robot):
    """What a walk of a robot shows, voltages and all, in counts."""
    seen = course(read(), marvin())
    moved, track = walked_by(robot, 2), play(robot, seen)
    times, _ = seen.voltage
    volts = np.round(np.interp(times, track.look_t_s, track.voltage_v) / COUNT_V) * COUNT_V
    return replace(moved, voltage=(times, volts), name="told")


def with_supply(share):
    supply = believed().supply
    return replace(believed(), supply=replace(supply, voltage_v=share * supply.voltage_v))


def with_gain(share):
    gain = placed_effects(believed())["gain_error@all"]
    return gain.apply(believed(), share)


@pytest.mark.parametrize("name", ["marvin", "phantomx"])
def test_registers_of_all_servos_are_one_voltage_over_the_phase(name):
    seen = course(read(name), load_robot(name))
    times, _ = seen.voltage
    assert (np.diff(times) >= 0.0).all()
    assert len(times) > 100
    features = Features.of(seen, load_robot(name))
    modelled = features.of_track(play(believed() if name == "marvin" else _physical(name), seen))
    known = np.isfinite(features.voltage_v)
    assert known.mean() > 0.9
    # the same robot: what is left is the register's step, and none of it lasts
    left = (features.voltage_v - modelled.voltage_v)[known]
    assert np.abs(left).max() < COUNT_V
    assert abs(left.mean()) < 0.5 * COUNT_V


def _physical(name):
    from sim.model import read_model  # noqa: PLC0415 - of one case

    return read_model(load_robot(name))


def test_without_voltages_or_with_too_few_there_is_no_such_channel():
    assert walked().voltage is None
    assert len(Features.of(walked(), marvin()).voltage_v) == 0
    assert course(read(reads=LEAST_SAMPLES - 1), marvin()).voltage is None
    assert course(read(reads=LEAST_SAMPLES), marvin()).voltage is not None


@pytest.fixture(scope="module")
def model():
    courses = [told(believed()), told(with_supply(LESS)), told(with_gain(LESS))]
    with RobotModel(believed(), marvin(), courses, without=KNOWN, processes=1) as made:
        yield made


@pytest.mark.slow
def test_replays_have_the_voltage_and_less_of_it_where_the_supply_has_less(model):
    volts = believed().supply.voltage_v
    kind = RobotKind.VOLTAGE
    plain, less, gain = (
        np.nanmean(model.recorded(r, kind) - model.centre[r][kind]) for r in range(3)
    )
    assert abs(plain) < 0.5 * COUNT_V
    assert less == pytest.approx(-(1.0 - LESS) * volts, abs=COUNT_V)
    assert abs(gain) < 0.5 * COUNT_V
    k = [n.name for n in model.nuisances].index("supply")
    trace = model.traces[0][kind][:, k] / model.nuisances[k].deviation
    assert trace.mean() == pytest.approx(volts, rel=0.05)


@pytest.mark.slow
def test_a_voltage_tells_a_supply_from_a_gain(model):
    names = ("supply_voltage@all", "gain_error@all")

    def ahead(r, kinds):
        """How much better a supply fits a recording than a gain does [nats]."""
        sight = Sight(model, [r], kinds)
        supply, gain = (sight.fit((name,), None).cost for name in names)
        return gain - supply

    joints, both = (RobotKind.JOINTS,), (RobotKind.JOINTS, RobotKind.VOLTAGE)
    assert ahead(1, both) > ahead(1, joints) + 5.0
    assert ahead(2, both) < ahead(2, joints) - 5.0


@pytest.mark.slow
def test_a_fit_says_what_of_its_cost_is_of_voltages(model):
    both = Sight(model, [1], (RobotKind.JOINTS, RobotKind.VOLTAGE))
    supply, gain = (both.fit((name,)) for name in ("supply_voltage@all", "gain_error@all"))
    assert gain.once > supply.once + 5.0
    again = both.at(gain)
    assert again.once == pytest.approx(gain.once)
    volts = Sight(model, [1], (RobotKind.VOLTAGE,)).blocks(gain.names, gain.z)
    assert gain.once == pytest.approx(both.cost(volts, gain.noise))
    assert Sight(model, [1], (RobotKind.JOINTS,)).fit(("gain_error@all",)).once == 0.0


def read_in(course, parity):
    """A walk whose voltage was read in every other bin of the phase only."""
    seen = Features.of(course, marvin())
    times, volts = course.voltage
    some = seen.voltage_bins.bin % 2 == parity
    name = f"walk-{parity}"
    return replace(course, voltage=(times[some], volts[some]), name=name, group=name)


@pytest.mark.slow
def test_a_repeat_whose_voltage_was_read_at_other_phases_moves_as_the_first_does():
    courses = [read_in(told(believed()), parity) for parity in (0, 1)]
    kind, less = RobotKind.VOLTAGE, (("supply_voltage@all", LESS),)
    with RobotModel(believed(), marvin(), courses, without=KNOWN, processes=1) as made:
        zero = np.zeros(len(made.nuisances))
        known = [np.isfinite(made.recorded(r, kind)) for r in (0, 1)]
        assert not (known[0] & known[1]).any()
        assert all(np.isfinite(rows[kind]).all() for rows in made.centre)
        volts = believed().supply.voltage_v
        k = [n.name for n in made.nuisances].index("supply")
        assert made.traces[1][kind][:, k] / made.nuisances[k].deviation == pytest.approx(
            np.full(len(known[0]), volts), rel=0.1
        )
        begun = [rows[kind] for rows in made.centre]
        with made.following():
            made.recentre(less, zero)
        first, repeat = (made.centre[r][kind] - begun[r] for r in (0, 1))
        assert repeat == pytest.approx(np.full(len(repeat), first[known[0]].mean()), abs=0.02)
        assert repeat.max() < -5.0 * COUNT_V
        assert np.isfinite(Sight(made, [0, 1], (kind,)).fit().cost)


@pytest.mark.parametrize("recordings", [1, 4])
@pytest.mark.slow
def test_all_recordings_together_tell_a_voltage_once(model, recordings):
    noise = voltage_noise(model, recordings)
    level = VOLTAGE_SENSE * believed().supply.voltage_v
    once = np.sqrt(recordings)
    assert (noise.white, noise.coloured) == pytest.approx((VOLTAGE_FLOOR_V * once, level * once))
    sight = Sight(model, [0, 1, 2], [RobotKind.VOLTAGE])
    blocks = sight.blocks((), np.zeros(len(model.nuisances)))
    assert sight.noise(blocks)[RobotKind.VOLTAGE] == voltage_noise(model, 3)


@pytest.mark.parametrize("recorded", [False, True])
def test_the_report_says_that_nobody_read_a_voltage(recorded):
    floors = {RobotKind.VOLTAGE: 0.05} if recorded else {}
    told = SimpleNamespace(condition={}, sample_s=())
    features = [SimpleNamespace(course=told, phase=object(), shaken=np.zeros(1))]
    base = SimpleNamespace(joints=())
    model = SimpleNamespace(floors=lambda: floors, features=features, nuisances=(), base=base)
    said = " ".join(limits(model, SimpleNamespace(nuisances=np.empty(0)), [0], held_out=True))
    assert ("nobody read a voltage" in said) is not recorded
