"""Which names of a whole robot hold, on squares and residuals that are given."""

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from bench.diagnosis.joint.growing import RELIEF
from bench.diagnosis.joint.rivals import CLOSE
from bench.diagnosis.noise import Block
from bench.diagnosis.result import Estimate
from bench.diagnosis.robot import settling
from bench.diagnosis.robot.causes import ENGINES_SHARE
from bench.diagnosis.robot.denials import DUTIES_OFF, VOLTS_OFF
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.features import RobotKind
from bench.diagnosis.robot.fit import FIRM, RobotFit
from bench.diagnosis.robot.gains import APART_NATS, RobotFindings, RobotGain
from bench.diagnosis.robot.judges import (
    ENDS,
    FALLEN,
    FAR,
    FITTED,
    JUDGED,
    LITTLE,
    SAMPLES,
    STANDING,
    Squares,
)
from bench.diagnosis.robot.limits import other_volts
from bench.diagnosis.robot.model import ENGINES_RAD, VOLTAGE_SENSE
from bench.diagnosis.robot.nuisances import RobotNuisance, nuisances
from bench.diagnosis.robot.rest import LOCAL
from bench.diagnosis.robot.settling import (
    AS_WELL,
    ASSUMED,
    DRIVEN,
    FAINT,
    FARTHER,
    NO_BETTER,
    NO_PART,
    NO_SIZE,
    ORDINARY,
    OTHER_VOLTS,
    STANDS_IN,
    UNLIKELY,
    UNSURE,
    RobotJudges,
)
from bench.diagnosis.robot.steps import BESIDE, LEFT_OUT, WORSE
from busemu.tables import load_robot
from sim.effects import Group
from sim.model import read_model

FLOOR_RAD, EXTRA_RAD2 = 1e-3, 3e-6
FITS, JUDGES = (0, 1), (2,)
SUPPLY_V = 10.0
OFF = 1.0  #: at which the model is as without an effect


#: ten joints of ten bins each
ROWS = SimpleNamespace(
    phase=object(),
    joint_row=np.repeat(np.arange(10), 10),
    bin=np.tile(np.arange(10), 10),
    stance=np.tile(np.arange(10), 10) < 6,
    goal_rad=np.sin(np.arange(100)),
    position_rad=np.sin(np.arange(100)),
    rounding_rad2=np.zeros(100),
)


class Walked(RobotJudges):
    """Judges that have seen samples so far off, RMS [rad]."""

    __slots__ = ()
    steady_rad: ClassVar = 0.0

    def samples(self, found):
        return Squares(self.steady_rad**2, self.steady_rad**2)


def judges(left, held_out=True, volts=None, joint_rad=0.0):
    """Of a model whose recordings leave so much, RMS [rad] by recording, and of voltages [V].

    One joint is off by ``joint_rad`` besides.
    """

    def residuals(names, z, which):
        rows = np.arange(100) * 1.0
        turns = np.random.default_rng(5)
        found = {}
        for r in which:
            value = left[r] * turns.permutation(np.where(rows % 2, -1.0, 1.0))
            value[ROWS.joint_row == 3] += joint_rad
            found[r, RobotKind.JOINTS] = Block(rows, value, np.full(100, EXTRA_RAD2))
        if volts is not None:
            wave = volts + 0.2 * np.sin(rows)
            found |= {(r, RobotKind.VOLTAGE): Block(rows, wave, 0.0 * rows) for r in which}
        return found

    model = SimpleNamespace(
        floors=lambda: {RobotKind.JOINTS: FLOOR_RAD},
        recentre=lambda settings, z, which: 0.0,
        residuals=residuals,
        nuisances=TOLERANCES,
        features=[ROWS] * 3,
        motion=[0, 0, 0],
        spread={0: {RobotKind.JOINTS: np.zeros(100)}},
        quantum_rad=0.0,
        chance=lambda r: np.zeros(100),
        placed={n: effect_of(n) for n in ("gain", "limit", "far", "a")}
        | {n: effect_of(n, Group.GEAR) for n in ("supply", "tips")},
        base=SimpleNamespace(
            supply=SimpleNamespace(voltage_v=SUPPLY_V),
            joints=[SimpleNamespace(name=f"leg{n}.femur") for n in range(10)],
        ),
    )
    search = SimpleNamespace(model=model)
    return Walked(search, FITS, JUDGES if held_out else FITS, None, held_out)


def taken_as(*z):
    return SimpleNamespace(names=(), z=np.empty(0), settings=(), nuisances=np.array(z))


#: three tolerances of a whole robot and one of a joint
TOLERANCES = tuple(
    RobotNuisance(name, "(ratio)", 1.0, "", reach=2.0, same=same)
    for name, same in (
        ("mass of the tibiae", ("link_mass@tibia",)),
        ("supply", ("supply_voltage",)),
        ("floor's friction", ("foot_slip",)),
        ("zero leg1.coxa", ()),
    )
)
BASE = taken_as(0.0, 0.0, 0.0, 0.0)


def rms(share):
    return float(np.sqrt(share * (FLOOR_RAD**2 + EXTRA_RAD2)))


def test_what_is_left_is_told_in_squares_of_noise():
    found = judges({0: rms(0.2), 1: rms(0.4), 2: rms(2.0)})
    assert found.over_noise(BASE, FITS) == pytest.approx(0.3)
    assert found.over_noise(BASE, JUDGES) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("along", "apart", "told"), [(1.0, 0.5, 0.85), (3.0, 0.5, 7.25), (0.0, 2.0, 4.0)]
)
def test_of_robots_that_stand_what_changes_is_told_apart_from_what_lasts(along, apart, told):
    """In deviations: what all samples have, of chance four times noise, and how they change."""
    own = rms(1.0)
    wave = np.where(np.arange(100) % 2, -1.0, 1.0)
    value = own * (2.0 * along + apart * wave)
    block = Block(np.arange(100.0), value, np.full(100, EXTRA_RAD2), np.full((100, 1), 2.0 * own))
    found = judges({0: 0.0, 1: 0.0})
    found.model.residuals = lambda names, z, which: {(0, RobotKind.JOINTS): block}
    whole = (4.0 * along**2 + apart**2) / (1.0 + 4.0)
    assert found.over_noise(BASE, [0]) == pytest.approx(max(whole, apart**2))
    assert found.over_noise(BASE, [0]) == pytest.approx(told)


@pytest.mark.parametrize(("share", "expected"), [(0.9, True), (1.1, False)])
def test_where_robots_stand_more_is_noise_and_tolerances_go_where_chance_takes_them(
    share, expected
):
    found = judges(dict.fromkeys((*FITS, *JUDGES), rms(share * STANDING)), held_out=False)
    found.model.features = [replace_all(ROWS, phase=None, shows=lambda other: True)] * 3
    found.model.chance = lambda r: np.full(100, EXTRA_RAD2)
    assert found.consistent(BASE) is expected
    far = taken_as(2.0, 2.0, 2.0, 0.0)
    assert found.consistent(far) is expected
    assert found.strained(far) == ()
    found.model.features[0] = ROWS
    assert found.strained(far) == ()
    found.model.features[1] = ROWS
    assert len(found.strained(far)) == 3


def replace_all(one, **changes):
    return SimpleNamespace(**{**vars(one), **changes})


@pytest.mark.parametrize(
    ("fitted", "judged", "expected"),
    [
        (0.9 * FITTED, 0.9 * JUDGED, True),
        (1.1 * FITTED, 0.9 * JUDGED, False),
        (0.9 * FITTED, 1.1 * JUDGED, False),
    ],
)
def test_a_robot_is_as_believed_where_neither_leaves_more_than_noise(fitted, judged, expected):
    left = {0: rms(fitted), 1: rms(fitted), 2: rms(judged)}
    assert judges(left).consistent(BASE) is expected


@pytest.mark.parametrize(("times", "expected"), [(0.95, True), (1.05, False)])
def test_a_robot_is_not_as_believed_whose_samples_are_far_off(monkeypatch, times, expected):
    monkeypatch.setattr(Walked, "steady_rad", times * SAMPLES * ENGINES_RAD)
    found = judges(dict.fromkeys(range(3), rms(0.05)))
    assert found.unlike(BASE) is not expected
    assert found.consistent(BASE) is expected


@pytest.mark.parametrize(("times", "expected"), [(0.9, True), (1.2, False)])
def test_a_robot_is_not_as_believed_where_one_joint_is_off_by_itself(times, expected):
    left = dict.fromkeys(range(3), rms(0.05))
    found = judges(left, joint_rad=times * LOCAL * ENGINES_RAD)
    assert found.over_noise(BASE, FITS) < FITTED
    assert found.consistent(BASE) is expected


@pytest.mark.parametrize(
    ("share", "denied"), [(0.0, False), (0.9, False), (-0.9, False), (1.1, True), (-1.1, True)]
)
def test_a_robot_is_not_as_believed_where_its_servos_show_another_voltage(share, denied):
    volts = share * VOLTS_OFF * VOLTAGE_SENSE * SUPPLY_V
    left = {0: rms(0.9 * FITTED), 1: rms(0.9 * FITTED), 2: rms(0.9 * JUDGED)}
    found = judges(left, volts=volts)
    assert found.consistent(BASE) is not denied
    assert found.volts_denied(BASE) == pytest.approx(volts if denied else 0.0, abs=0.01)
    assert judges(left).volts_denied(BASE) == 0.0


@pytest.mark.parametrize("off", [0.9 * DUTIES_OFF, 1.1 * DUTIES_OFF])
def test_a_robot_is_not_as_believed_where_loads_show_another_law(monkeypatch, off):
    found = judges({0: rms(0.9 * FITTED), 1: rms(0.9 * FITTED), 2: rms(0.9 * JUDGED)})
    assert found.duties_off(BASE) == 0.0  # nobody read one
    monkeypatch.setattr(RobotJudges, "duties_off", lambda self, fit: off)
    assert found.consistent(BASE) is (off < DUTIES_OFF)
    assert found.duties_denied(BASE) == (off if off > DUTIES_OFF else 0.0)


def test_what_servos_show_and_nobody_explains_is_told():
    assert other_volts(0.0) == ()
    assert "servos show 1.30 V less than" in other_volts(-1.3)[0]
    assert "servos show 0.70 V more than" in other_volts(0.7)[0]


@pytest.mark.parametrize(
    ("tolerances", "expected"),
    [
        ((1.9, -1.9, 1.9, 0.0), True),
        ((2.0, 0.0, 0.0, -2.0), True),
        ((2.0, 0.0, -2.0, 0.0), False),
    ],
)
def test_a_robot_is_not_as_believed_where_tolerances_stand_at_their_ends(tolerances, expected):
    left = {0: rms(0.9 * FITTED), 1: rms(0.9 * FITTED), 2: rms(0.9 * JUDGED)}
    assert judges(left).consistent(taken_as(*tolerances)) is expected


@pytest.mark.parametrize(("times", "expected"), [(0.9, False), (1.1, True)])
def test_a_fit_is_far_from_what_it_was_fitted_to(times, expected):
    left = {0: rms(times * FAR * FITTED), 1: rms(times * FAR * FITTED), 2: rms(9.0 * JUDGED)}
    assert judges(left).far(BASE) is expected


@pytest.mark.parametrize(
    ("tolerances", "expected"),
    [
        ((2.0, 0.0, 0.0, 4.0), ()),  # of a joint
        ((2.0, -1.9, 1.9, 0.0), ()),  # one at its end
        ((2.0, -2.0, 0.0, 0.0), ("mass of the tibiae", "supply")),
    ],
)
def test_tolerances_stand_in_for_something_where_several_are_at_their_ends(tolerances, expected):
    assert judges({}).strained(taken_as(*tolerances)) == expected


def test_a_tolerance_that_gains_nothing_where_it_may_go_farther_stands_in_for_nothing():
    found, ends = judges({}), taken_as(2.0, -2.0, 2.0, 0.0)
    every = tuple(n.name for n in TOLERANCES[:3])
    assert found.strained(ends) == every
    assert found.strained(ends, {"supply_voltage"}) == (every[0], every[2])
    assert found.strained(ends, {"supply_voltage", "foot_slip"}) == ()


def test_in_vain_was_what_was_fitted_to_the_end_and_gained_nothing_in_any_step():
    def gain(name, nats, held_out=0.0):
        return RobotGain(name, taken_as(), nats, 1.0, held_out)

    steps = (
        (gain("slip", 9.0), gain("tilt", -3.0), gain("mass", -40.0, None)),
        (gain("tilt", -1.0), gain("slip", -5.0)),
    )
    assert RobotFindings(BASE, BASE, (), steps, {}, ()).in_vain == {"tilt"}


@pytest.mark.parametrize(
    ("where", "tolerances", "expected"),
    [
        (("leg1",), (2.0, -1.95, 1.95, 9.0, 9.0), True),  # by chance one time in a hundred
        (("leg1.femur",), (2.0, -1.95, 1.95, 0.0, 0.0), True),
        (("leg1", "leg2"), (2.0, -1.95, 1.95, 0.0, 0.0), False),
        (("leg1",), (1.9, -1.9, 1.9, 9.0, 9.0), False),
        (("leg2.femur",), (2.0, -1.95, 1.95, 0.0, 9.0), False),
        (("trunk",), (2.0, -1.95, 1.95, 9.0, 9.0), False),
        ((), (2.0, -1.95, 1.95, 9.0, 9.0), False),
    ],
)
def test_a_name_stands_in_where_its_own_joints_are_farther_off_than_by_chance(
    where, tolerances, expected
):
    own = [f"{what} leg1.femur" for what in ("zero", "torque", "friction")]
    found = judges({})
    found.model.nuisances = [
        RobotNuisance(name, "", 1.0, "", reach=2.0)
        for name in (*own, "torque leg2.femur", "supply")
    ]
    found.model.placed["a"] = SimpleNamespace(where=where)
    assert found.pulled(taken_as(*tolerances), "a") is expected


@pytest.mark.parametrize(
    ("gain", "motors", "torques", "supply", "expected"),
    [
        (-1.5, -1.5, (-1.1, -1.1), 0.0, True),  # -4.56, of 4.46 by chance one time in a hundred
        (-1.4, -1.4, (-1.1, -1.1), 0.0, False),
        (1.5, 1.5, (1.1, 1.1), 0.0, True),
        (-2.0, -2.0, (0.0, 0.0), 2.0, False),  # all must go one way
        (-2.0, 2.0, (-1.1, -1.1), 2.0, False),
        (-1.5, -1.5, (-2.2, 0.0), 0.0, True),
        (-1.5, -1.5, (-2.2, 2.2), 0.0, False),
        (-1.4, -1.4, (-1.1, -1.1), -2.0, False),  # which is read
    ],
)
def test_servos_of_all_joints_may_do_no_more_or_less_than_by_chance(
    gain, motors, torques, supply, expected
):
    found = judges({})
    names = ("gain", "supply", "torque leg1.femur", "motors", "torque leg2.femur", "friction leg1")
    found.model.nuisances = [RobotNuisance(name, "", 1.0, "", reach=2.0) for name in names]
    fit = taken_as(gain, supply, torques[0], motors, torques[1], -2.0)
    assert found.driven(fit) is expected


def test_without_tolerances_of_servos_nothing_is_asked():
    found = judges({})
    found.model.nuisances = [RobotNuisance("supply", "", 1.0, "", reach=2.0)]
    assert found.driven(taken_as(2.0)) is False


def test_two_at_their_ends_among_many_that_are_near_stand_in_for_nothing():
    many = [
        RobotNuisance(f"mass {k}", "(ratio)", 1.0, "", reach=2.0, same=("x",)) for k in range(15)
    ]
    found = judges({})
    found.model.nuisances = many
    assert found.strained(taken_as(2.0, 2.0, *13 * [0.7])) == ()
    assert found.strained(taken_as(2.0, 2.0, *13 * [0.8])) == ("mass 0", "mass 1")


def test_zeros_of_joints_at_their_ends_stand_in_for_nothing():
    """A joint's own zero is no tolerance of the robot; far off, it is tried by its name."""
    zeros = [
        RobotNuisance(f"zero leg{k}.coxa", "rad", 1.0, "", reach=2.0, same=("x",))
        for k in range(15)
    ]
    found = judges({})
    found.model.nuisances = zeros
    assert found.strained(taken_as(*15 * [2.0])) == ()
    assert found.at_ends(taken_as(*15 * [2.0])) == []


def test_without_recordings_that_judge_those_that_were_fitted_say_it():
    left = {0: rms(0.9 * FITTED), 1: rms(0.9 * FITTED)}
    assert judges(left, held_out=False).consistent(BASE)


@pytest.fixture(autouse=True)
def numbers(monkeypatch):
    """Numbers of names are pinned but for those that are ``farthest``; none has a rival."""

    def number_of(search, now, name):
        state = "at bound" if name in Given.farthest else "pinned"
        return Estimate(0.0, Given.between, "", state)

    monkeypatch.setattr(settling, "number_of", number_of)
    monkeypatch.setattr(settling, "chance_of", lambda model, found, gain: Given.chance)


class Given(RobotJudges):
    """Squares of phase means and of samples by the names of a fit, floors aside."""

    __slots__ = ()
    phases: ClassVar = {}
    seen: ClassVar = {}
    whole: ClassVar = {}
    floor_square = 1.0
    sound_rad = 10.0
    stand_in: ClassVar = frozenset()
    denied: ClassVar = {}
    low: ClassVar = {}
    costs: ClassVar = {}
    calm: ClassVar = False
    usual: ClassVar = frozenset()
    pulls: ClassVar = frozenset()
    drives: ClassVar = frozenset()
    share: ClassVar = 1.0
    foretold: ClassVar = 0.0
    tolerances: ClassVar = ()
    between: ClassVar = (OFF + 0.1, OFF + 0.5)
    counts: ClassVar = 1.1 * BESIDE
    free: ClassVar = True
    farthest: ClassVar = frozenset()
    left_out: ClassVar = 1.0
    chance: ClassVar = 1.0

    def quiet(self, base):
        return self.calm

    def placid(self, base):
        return self.calm

    def at_ends(self, base):
        return ["gain"] * (ENDS if self.free else ENDS + 1)

    def undenied(self, found):
        return found

    def ordinary(self, now, name):
        return name in self.usual

    def pulled(self, now, name):
        return name in self.pulls

    def driven(self, now):
        return self.drives.intersection(now.names)

    def explainable(self, base, now):
        return 1.0

    def explained(self, without, now, explainable):
        return self.share

    def rest(self, found):
        return SimpleNamespace(foretold=self.foretold)

    def outside(self, found, firm=1.0):
        assert firm == FIRM
        return self.costs[found.names]

    def strained(self, found):
        return ("gain",) if found.names in self.stand_in else ()

    def volts_denied(self, found):
        return self.denied.get(found.names, 0.0)

    def duties_denied(self, found):
        return self.low.get(found.names, 0.0)

    def resized(self, now, name):
        return now

    def square(self, found, which):
        return self.phases[found.names]

    def samples(self, found):
        return Squares(self.seen[found.names], self.whole[found.names])

    def without(self, base, now, name):
        left = tuple(other for other in now.names if other != name)
        return SimpleNamespace(names=left)


def effect_of(name, group=Group.CONTROLLER):
    effect = SimpleNamespace(name=name, group=group)
    return SimpleNamespace(effect=effect, where=(), parameter=SimpleNamespace(off=OFF))


def kept(
    phases,
    seen=None,
    whole=None,
    stand_in=(),
    costs=None,
    denied=None,
    low=None,
    because=NO_BETTER,
    risen=(),
    base=(),
    own_gear=(),
    deflated=None,
):
    names = max(phases, key=len)
    placed = {n: effect_of(n, Group.GEAR if n in own_gear else Group.CONTROLLER) for n in names}
    placed["rotors"] = effect_of("rotors")
    search = SimpleNamespace(model=SimpleNamespace(placed=placed, nuisances=Given.tolerances))
    own = Given(search, FITS, JUDGES, None, held_out=True)
    Given.phases, Given.seen = phases, seen or phases
    Given.whole, Given.stand_in = whole or Given.seen, frozenset(stand_in)
    Given.costs, Given.denied, Given.low = costs or {}, denied or {}, low or {}
    one = {"held_out": own.left_out, "counting": lambda _: own.counts}
    gained = deflated or dict.fromkeys(names, 20.0)
    gains = [SimpleNamespace(name=n, deflated=gained[n], **one) for n in names]
    base = SimpleNamespace(names=base)
    found = SimpleNamespace(base=base, fit=SimpleNamespace(names=names), taken=gains, tried=())
    _, taken, now, rejected = own.kept(found, lambda _: None, lambda fit: fit.names in risen)
    assert now.names == tuple(gain.name for gain in taken)
    assert all(row["because"] == because for row in rejected)
    return now.names


def test_a_name_that_takes_much_of_the_misfit_away_stays():
    assert kept({(): 5.0, ("a",): 1.5}) == ("a",)


RATTLES = {("a",): 6.4, ("backlash@all",): 9.0, (): 9.0}


@pytest.mark.parametrize(
    ("left", "more", "stays"),
    [
        (5.1, {}, ""),  # half of eight is four
        (4.9, {}, "a"),
        (5.1, {"phases": {(): 9.0, ("a",): 1.5}}, ""),  # whatever means over the phase show
        (2.4, {"seen": {(): 2.5, ("a",): 2.4}}, "a"),  # no farther off than noise may be
        (2.4, {"seen": {(): 2.7, ("a",): 2.4}}, ""),  # nor are they now, but hardly by the name
        (1.8, {"seen": {(): 2.7, ("a",): 1.8}}, "a"),
        (6.4, {"phases": {(): 42.0, ("a",): FALLEN + 1.0}}, "a"),  # lies otherwise
        (6.4, {"base": ("backlash@all",), "phases": RATTLES, "seen": RATTLES}, "a"),
        (6.4, {"denied": {(): 1.0}}, "a"),  # voltages ask for it
        (6.4, {"low": {(): 1.0}}, "a"),  # loads do
        (6.4, {"low": {(): 1.0}, "own_gear": "a"}, ""),  # loads ask for nothing outside a law
    ],
)
def test_names_that_leave_most_of_what_is_far_off_are_no_part_of_it(monkeypatch, left, more, stays):
    monkeypatch.setattr(Given, "sound_rad", 1.0)
    given = {"phases": {(): 9.0, ("a",): 6.4}, "seen": {(): 9.0, ("a",): left}} | more
    assert kept(**given, because=NO_PART) == tuple(stays)


@pytest.mark.parametrize(
    ("name", "left", "stays"),
    [
        ("backlash@all", 5.7, True),
        ("backlash@all", 5.9, False),
        ("joint_compliance@all", 2.0, False),
    ],
)
def test_play_must_take_its_part_of_means_as_samples_rattle(monkeypatch, name, left, stays):
    """Of eight above the floor 3.2."""
    monkeypatch.setattr(Given, "sound_rad", 1.0)
    means, samples = {(): 9.0, (name,): left}, {(): 9.0, (name,): 6.4}
    assert kept(means, seen=samples, because=NO_PART) == ((name,) if stays else ())


def test_of_names_that_are_no_part_of_it_those_stay_that_a_register_asks_for(monkeypatch):
    monkeypatch.setattr(Given, "sound_rad", 1.0)
    squares = {(): 9.0, ("a",): 7.5, ("b",): 8.0, ("a", "b"): 6.5}
    asked = {(): 0.7, ("a",): 0.7}  # another voltage, but with b
    costs = {("a", "b"): 99.0, ("a",): 100.0}
    assert kept(squares, denied=asked, costs=costs, because=NO_PART) == ("b",)
    half = squares | {("a", "b"): 4.9}
    assert kept(half, denied=asked, costs=costs) == ("a", "b")


@pytest.mark.parametrize(
    ("calm", "usual", "stays"), [(True, "a", ""), (True, "b", "a"), (False, "a", "a")]
)
def test_where_no_more_than_noise_is_left_a_name_must_be_more_than_a_tolerance(
    monkeypatch, calm, usual, stays
):
    monkeypatch.setattr(Given, "calm", calm)
    monkeypatch.setattr(Given, "usual", {usual})
    assert kept({(): 5.0, ("a",): 1.5}, because=ORDINARY) == tuple(stays)


@pytest.mark.parametrize(
    ("strained", "share", "stays"),
    [
        ([()], 1.1, "a"),
        ([()], 0.9, ""),  # gains too little
        ([(), ("a",)], 1.1, ""),  # and frees nothing
        ([], 1.1, ""),
    ],
)
def test_a_size_that_is_ordinary_is_more_where_it_frees_several_tolerances(
    monkeypatch, strained, share, stays
):
    for name, value in {"calm": True, "free": False, "usual": {"a"}}.items():
        monkeypatch.setattr(Given, name, value)
    monkeypatch.setattr(Given, "counts", share * BESIDE)
    found = kept({(): 5.0, ("a",): 1.5}, stand_in=strained, because=ORDINARY)
    assert found == tuple(stays)


@pytest.mark.parametrize(("farthest", "stays"), [("a", "b"), ("b", "a")])
def test_a_name_that_would_go_farther_than_it_may_stands_for_something_else(
    monkeypatch, farthest, stays
):
    monkeypatch.setattr(Given, "farthest", {farthest})
    squares = {(): 9.0, ("a",): 4.0, ("b",): 4.0, ("a", "b"): 1.5}
    assert kept(squares, because=FARTHER) == (stays,)


@pytest.mark.parametrize(
    ("calm", "free", "share", "stays"),
    [
        (True, True, 1.1, "a"),
        (True, True, 0.9, ""),
        (True, False, 0.9, "a"),
        (False, True, 0.9, "a"),
    ],
)
def test_of_a_robot_that_is_consistent_a_name_must_gain_as_much_as_beside_another(
    monkeypatch, calm, free, share, stays
):
    """Not of one that leaves no more than noise with tolerances that stand in for something."""
    monkeypatch.setattr(Given, "calm", calm)
    monkeypatch.setattr(Given, "free", free)
    monkeypatch.setattr(Given, "counts", share * BESIDE)
    assert kept({(): 5.0, ("a",): 1.5}, because=FAINT) == tuple(stays)


@pytest.mark.parametrize(
    ("what", "enough", "too_little", "because"),
    [
        ("counts", 1.1 * BESIDE, 0.9 * BESIDE, FAINT),
        ("left_out", 0.1, -0.1, LEFT_OUT),
        ("left_out", None, -0.1, LEFT_OUT),  # all recordings are of one group
        ("chance", 1.1 * UNLIKELY, 0.9 * UNLIKELY, UNSURE),
        ("pulls", frozenset(), frozenset("a"), STANDS_IN),
    ],
)
@pytest.mark.parametrize(
    ("registers", "asks"),
    [
        ({}, False),
        ({"low": {(): 9.0, ("a",): 5.0}}, False),  # which is not what loads show
        ({"denied": {(): -0.7}}, True),
    ],
)
def test_a_name_that_no_register_asks_for_must_be_firm(
    monkeypatch, what, enough, too_little, because, registers, asks
):
    """Where positions are as believed and a register denies that, what it does not ask for, too."""
    monkeypatch.setattr(Given, "calm", True)
    squares = {(): 5.0, ("a",): 1.5}
    for value, stays in ((enough, "a"), (too_little, "a" if asks else "")):
        monkeypatch.setattr(Given, what, value)
        assert kept(squares, **registers, because=because) == tuple(stays)


@pytest.mark.parametrize("registers", [{}, {"denied": {(): -0.7}}])
def test_a_name_must_leave_servos_what_they_are_by_chance_whatever_asks_for_it(
    monkeypatch, registers
):
    squares = {(): 5.0, ("a",): 1.5}
    assert kept(squares, **registers) == ("a",)
    monkeypatch.setattr(Given, "drives", frozenset("a"))
    assert kept(squares, **registers, because=DRIVEN) == ()


@pytest.mark.parametrize(("gains", "stays"), [((90.0, 50.0), "a"), ((50.0, 90.0), "b")])
def test_of_several_beside_which_servos_are_not_that_goes_which_gained_least(
    monkeypatch, gains, stays
):
    """And the other stays if they are without it."""
    monkeypatch.setattr(Given, "drives", frozenset("b" if stays == "a" else "a"))
    squares = {(): 9.0, ("a",): 5.0, ("b",): 5.0, ("a", "b"): 1.5}
    assert kept(squares, deflated=dict(zip("ab", gains, strict=True)), because=DRIVEN) == (stays,)


@pytest.mark.parametrize(
    ("left", "stays"), [(0.0, ("a",)), (-0.3, ("a",)), (-0.4, ()), (-0.7, ()), (0.4, ())]
)
def test_a_name_must_leave_voltages_as_servos_show_them(left, stays):
    """Else what hides in them is in how the robot moves as well, under the nearest name."""
    found = kept({(): 5.0, ("a",): 1.5}, denied={(): -0.7, ("a",): left}, because=OTHER_VOLTS)
    assert found == stays


@pytest.mark.parametrize(
    ("name", "stays"),
    [("backlash@femur+tibia", True), ("joint_compliance@all", False), ("dead_zone@all", False)],
)
def test_no_other_voltage_stands_in_for_play(name, stays):
    """Which was hidden behind a gain, and servos showed what hid that."""
    found = kept({(): 5.0, (name,): 1.5}, denied={(): -0.7, (name,): -0.7}, because=OTHER_VOLTS)
    assert found == ((name,) if stays else ())


def test_beside_a_name_that_mends_voltages_another_holds():
    squares = {(): 9.0, ("a",): 5.0, ("b",): 5.0, ("a", "b"): 1.5}
    costs = {("a", "b"): 99.0, ("a",): 100.0}
    assert kept(squares, denied={(): -0.7, ("a",): -0.7}, costs=costs) == ("a", "b")
    denied = dict.fromkeys(squares, -0.7)
    assert kept(squares, denied=denied, because=OTHER_VOLTS) == ()


@pytest.mark.parametrize(
    ("between", "stays"),
    [
        ((OFF + 0.1, OFF + 0.5), True),
        ((OFF - 0.5, OFF - 0.1), True),
        ((OFF, OFF + 0.5), False),
        ((OFF - 0.1, OFF + 0.5), False),
        ((OFF - 0.5, OFF), False),
    ],
)
@pytest.mark.parametrize("denied", [{}, {(): -0.7}])
def test_a_name_must_be_of_some_size_whatever_asks_for_it(monkeypatch, between, stays, denied):
    monkeypatch.setattr(Given, "between", between)
    left = kept({(): 5.0, ("a",): 1.5}, denied=denied, because=NO_SIZE)
    assert left == (("a",) if stays else ())


@pytest.mark.parametrize(
    ("between", "stays"),
    [
        ((OFF * 1.21, OFF * 1.5), True),
        ((OFF * 1.19, OFF * 1.5), False),
        ((OFF * 0.5, OFF * 0.79), True),
        ((OFF * 0.5, OFF * 0.81), False),
    ],
)
@pytest.mark.parametrize(
    ("name", "doubt", "asked"), [("a", 0.2, True), ("a", 0.0, False), ("b", 0.2, False)]
)
def test_a_number_that_files_assume_must_be_farther_off_than_such_a_number_is(
    monkeypatch, between, stays, name, doubt, asked
):
    monkeypatch.setattr(Given, "between", between)
    one = RobotNuisance("rotors", "(ratio)", 0.02, "", same=(name,), doubt=doubt)
    monkeypatch.setattr(Given, "tolerances", (one,))
    left = kept({(): 5.0, ("a",): 1.5}, denied={(): -0.7}, because=ASSUMED)
    assert left == (("a",) if stays or not asked else ())


@pytest.mark.parametrize(
    ("close", "size", "doubt", "registers", "stays"),
    [
        (True, 0.8, 0.2, {}, False),
        (True, 0.8, 0.2, {"denied": {(): -0.7}}, True),  # a register asks for it
        (False, 0.8, 0.2, {}, True),
        (True, 0.7, 0.2, {}, True),  # no such number is so far off
        (True, 0.8, 0.0, {}, True),
        (True, 1.0, 0.0, {}, True),
    ],
)
def test_what_a_number_that_files_assume_does_as_well_has_no_name(
    monkeypatch, close, size, doubt, registers, stays
):
    """``close`` is whether it follows recordings as well, and ``size`` its own."""
    ends = {"a": (1.5, 2.0), "rotors": (size - 0.05, size + 0.05)}
    monkeypatch.setattr(
        settling, "number_of", lambda search, fit, name: Estimate(0.0, ends[name], "")
    )
    rivals = [SimpleNamespace(name="rotors", fit=None)] if close else []
    monkeypatch.setattr(settling, "close_rivals", lambda model, found, gain: rivals)
    one = RobotNuisance("rotors", "(ratio)", 0.02, "", same=("rotors",), doubt=doubt)
    monkeypatch.setattr(Given, "tolerances", (one,))
    left = kept({(): 5.0, ("a",): 1.5}, **registers, because=AS_WELL)
    assert left == (("a",) if stays else ())


@pytest.mark.parametrize(
    ("foretold", "chance", "registers", "stays"),
    [
        (0.0, 0.9, {}, True),
        (0.7, 0.9, {}, True),  # 0.2 of what it and a rest have: 0.9 times that is 0.2
        (1.7, 0.9, {}, False),
        (0.7, 0.4, {}, False),
        (1.7, 0.9, {"denied": {(): -0.7}}, True),  # a register asks for it
    ],
)
def test_a_name_that_has_next_to_no_part_beside_a_rest_is_not_said(
    monkeypatch, foretold, chance, registers, stays
):
    monkeypatch.setattr(Given, "share", 0.175)
    monkeypatch.setattr(Given, "foretold", foretold)
    monkeypatch.setattr(Given, "chance", chance)
    left = kept({(): 5.0, ("a",): 1.5}, **registers, because=UNSURE)
    assert left == (("a",) if stays else ())


def test_what_is_left_is_asked_again_without_what_was_refused(monkeypatch):
    """A name that holds only beside one that does not goes as well."""

    def refused(self, found, now, gain, **how):
        return NO_SIZE if gain.name == "b" or "b" not in now.names else ""

    monkeypatch.setattr(Given, "_refused", refused)
    squares = {names: 5.0 - len(names) for names in ((), ("a",), ("b",), ("a", "b"))}
    assert kept(squares, because=NO_SIZE) == ()


@pytest.mark.parametrize(
    ("name", "ends", "ordinary"),
    [
        ("ground_tilt.pitch@all", (0.021, 0.04), False),
        ("ground_tilt.pitch@all", (0.019, 0.04), True),
        ("ground_tilt.pitch@all", (-0.04, -0.021), False),
        ("ground_tilt.pitch@all", (-0.04, -0.019), True),
        ("link_mass@trunk", (1.06, 1.2), False),
        ("link_mass@trunk", (1.05, 1.2), True),
        ("transport_delay@all", (0.0021, 0.004), False),
        ("transport_delay@all", (0.0019, 0.004), True),
        ("transport_delay@all", (0.0005, 0.0015), True),
        ("foot_compliance@all", (400.0, 19e3), False),
        ("foot_compliance@all", (400.0, 21e3), True),
        ("foot_compliance@all", (30e3, 60e3), True),
        ("dead_zone@all", (0.0, 0.01), False),  # no tolerance is one
    ],
)
def test_a_name_whose_interval_reaches_into_its_tolerance_may_be_that(
    monkeypatch, name, ends, ordinary
):
    base = read_model(load_robot("marvin"))
    model = SimpleNamespace(
        base=base, placed=placed_effects(base), nuisances=nuisances(base, 0.005)
    )
    search = SimpleNamespace(model=model)
    monkeypatch.setattr(settling, "number_of", lambda *_: Estimate(0.0, ends, "", "pinned"))
    found = RobotJudges(search, FITS, JUDGES, None, held_out=True)
    assert found.ordinary(BASE, name) is ordinary


def test_a_name_that_takes_less_than_a_tenth_away_goes():
    before = 5.0
    least = LITTLE * (before - 1.0)
    assert kept({(): before, ("a",): before - 1.1 * least}) == ("a",)
    assert kept({(): before, ("a",): before - 0.9 * least}) == ()


def test_of_a_robot_that_lies_otherwise_a_name_must_take_no_tenth_of_that():
    before = 1.0 + 100.0 * FALLEN
    squares = {(): before, ("a",): 5.0 * FALLEN, ("b",): before}
    least = LITTLE * FALLEN
    assert kept(squares | {("a", "b"): 5.0 * FALLEN - 1.1 * least}) == ("a", "b")
    assert kept(squares | {("a", "b"): 5.0 * FALLEN - 0.9 * least}) == ("a",)


def test_where_little_is_to_be_explained_a_name_must_take_away_some_of_the_floor():
    assert kept({(): 1.1, ("a",): 1.1 - 1.1 * RELIEF}) == ("a",)
    assert kept({(): 1.1, ("a",): 1.1 - 0.9 * RELIEF}) == ()


def test_a_name_that_makes_samples_worse_goes_however_much_phases_gain():
    assert kept({(): 5.0, ("a",): 1.5}, {(): 5.0, ("a",): 5.1}) == ()


def test_a_name_that_tolerances_had_stood_in_for_need_not_be_better_where_they_foretell_as_much():
    before = 5.0
    least = LITTLE * (before - 1.0)
    slightly, more = {("a",): before + 0.9 * least}, {("a",): before + 1.1 * least}
    better = {(): 1.0, ("a",): 0.999}
    assert kept({(): before} | slightly, better, stand_in=[()]) == ("a",)
    assert kept({(): before} | slightly, better) == ()
    assert kept({(): before} | more, better, stand_in=[()]) == ()
    assert kept({(): before} | slightly, better, stand_in=[(), ("a",)]) == ()
    for samples, names in ((0.999, ("a",)), (1.001, ())):
        worse = {(): 1.0, ("a",): samples}
        assert kept({(): before} | slightly, worse, stand_in=[()]) == names


def test_a_name_that_loads_ask_for_holds_where_no_more_than_noise_is_left(monkeypatch):
    worse, whole = {(): 1.0, ("a",): 3.0}, {(): 1.0, ("a",): 1.0}
    assert kept(worse, whole=whole, low={(): 9.0}) == ()
    monkeypatch.setattr(Given, "calm", True)
    assert kept(worse, whole=whole, low={(): 9.0}) == ("a",)
    assert kept(worse, whole=whole) == ()


def test_a_name_that_voltages_ask_for_need_not_be_better_where_tolerances_foretell_as_much():
    slightly = {(): 1.0, ("a",): 1.0 + 0.9 * RELIEF}
    assert kept(slightly, denied={(): -0.7}) == ("a",)
    assert kept(slightly) == ()
    assert kept(slightly, low={(): 9.0}) == ("a",)
    assert kept(slightly, low={(): 9.0, ("a",): 4.6}) == ()
    for left, names in ((-0.7, ()), (-0.36, ()), (-0.34, ("a",)), (0.34, ("a",)), (0.36, ())):
        assert kept(slightly, denied={(): -0.7, ("a",): left}, because=OTHER_VOLTS) == names
    squares = {(): 9.0, ("a",): 2.0, ("b",): 9.0, ("a", "b"): 2.1}
    for outside, names in ((-1.0, ("a", "b")), (1.0, ("a",))):
        costs = dict.fromkeys(squares, 100.0) | {("a", "b"): 100.0 + outside}
        assert kept(squares, denied={("a",): -0.7}, costs=costs) == names
    for samples, names in ((0.99 * WORSE, ("a",)), (1.01 * WORSE, ())):
        worse, whole = {(): 1.0, ("a",): samples}, {(): 1.0, ("a",): 1.0}
        assert kept(slightly, worse, whole=whole, denied={(): -0.7}) == names


def test_what_registers_say_of_other_recordings_is_not_divided():
    own = judges({})
    blocks = {(2, RobotKind.JOINTS): 40.0, (2, RobotKind.VOLTAGE): 3.0, (2, RobotKind.DUTY): 2.0}
    own.search.sight = SimpleNamespace(
        blocks=lambda names, z, which: blocks, cost=lambda some, noise: sum(some.values())
    )
    found = RobotFit(("a",), np.zeros(1), {}, 0.0)
    assert RobotJudges.outside(own, found) == 45.0
    assert RobotJudges.outside(own, found, 4.0) == 15.0


@pytest.mark.parametrize(("outside", "names"), [(-1.0, ("a", "b")), (1.0, ("a",))])
def test_beside_another_a_name_that_tolerances_stood_in_for_must_gain_where_it_is_judged(
    outside, names
):
    squares = {(): 9.0, ("a",): 2.0, ("b",): 9.0, ("a", "b"): 2.1}
    costs = dict.fromkeys(squares, 100.0) | {("a", "b"): 100.0 + outside}
    samples = squares | {("a", "b"): 1.999}
    assert kept(squares, samples, stand_in=[("a",)], costs=costs) == names


def test_names_that_make_whole_recordings_much_worse_go_until_they_do_not():
    squares = {(): 9.0, ("a",): 4.0, ("b",): 6.0, ("a", "b"): 1.5}
    allowed, too_much = 0.99 * WORSE * 9.0, 1.01 * WORSE * 9.0
    whole = {(): 9.0, ("a",): allowed, ("b",): too_much, ("a", "b"): too_much}
    assert kept(squares, whole=whole) == ("a",)
    assert kept(squares, whole=whole | {("a",): too_much}) == ()
    assert kept(squares, whole=whole | {("a", "b"): allowed}) == ("a", "b")
    assert kept(squares, whole=whole, risen=[("a", "b")]) == ("a", "b")  # which says why
    no_better = {("b",): 3.9, ("a", "b"): 3.8}
    assert kept(squares | no_better, whole=whole, risen=[("a", "b"), ("b",)]) == ("b",)


def test_the_name_that_helps_least_goes_first_and_the_others_are_asked_again():
    squares = {(): 9.0, ("a",): 2.0, ("b",): 8.5, ("a", "b"): 1.9}
    assert kept(squares) == ("a",)


@pytest.mark.parametrize("begun", [(), ("play",)])
def test_without_its_only_finding_a_fit_is_the_one_it_began_with(begun):
    settled = []
    own = judges({})
    own.search.sight = SimpleNamespace(without=lambda now, name: (now.names, name))
    own.search.settle = lambda found: settled.append(found) or "settled"
    base, one = SimpleNamespace(names=begun), SimpleNamespace(names=(*begun, "a"))
    assert own.without(base, one, "a") is base
    two = SimpleNamespace(names=(*begun, "a", "b"))
    assert own.without(base, two, "b") == "settled"
    assert settled == [(two.names, "b")]


class Steep(Given):
    """Squares of a fit by the size of its only effect."""

    __slots__ = ()

    def square(self, found, which):
        return self.phases[tuple(found.z)] if len(found.z) else self.phases[()]

    def samples(self, found):
        return Squares(self.square(found, JUDGES), 1.0)

    def strained(self, found):
        return ()

    def resized(self, now, name):
        return RobotJudges.resized(self, now, name)

    def without(self, base, now, name):
        return base


def steep(at, squares, high=9.0):
    """What is kept of a name at a size, squares given by size."""
    placed = {"a": effect_of("a")}
    sight = SimpleNamespace(box=lambda names: (np.zeros(1), np.full(1, high)))
    search = SimpleNamespace(
        model=SimpleNamespace(placed=placed, nuisances=()),
        sight=sight,
        replayed=lambda found: found,
    )
    own = Steep(search, None, FITS, JUDGES, held_out=True)
    Given.phases = {tuple(np.clip([at * (1.0 + x)], 0, high)): y for x, y in squares.items()}
    Given.phases[()] = 5.0
    Given.denied, Given.low = {}, {}
    base, now = (RobotFit(n, np.array(z), {}, 0.0) for n, z in (((), []), (("a",), [at])))
    gain = SimpleNamespace(name="a", deflated=20.0, held_out=None)
    found = SimpleNamespace(base=base, fit=now, taken=[gain], tried=())
    _, taken, now, _ = own.kept(found, lambda _: None)
    return [gain.name for gain in taken], now.z.tolist()


WIDE, HALF = ENGINES_SHARE, 0.5 * ENGINES_SHARE


def test_a_name_is_taken_at_a_size_that_judges_bear_out_if_engines_may_differ_by_that():
    cliff = {0.0: 9.0, HALF: 6.0, WIDE: 6.0, -HALF: 1.5, -WIDE: 2.0}
    assert steep(2.0, cliff) == (["a"], [pytest.approx(2.0 * (1.0 - HALF))])
    nowhere = dict.fromkeys(cliff, 6.0) | {-WIDE: 4.9}
    assert steep(2.0, nowhere) == ([], [])
    # where it holds as it is, it is asked for at no other size
    assert steep(2.0, cliff | {0.0: 1.6}) == (["a"], [2.0])


class Leaning(Steep):
    """A cliff in the size of ``b`` that a robot with ``a`` stands on the wrong side of."""

    __slots__ = ()
    cliff: ClassVar = 0.0

    def square(self, found, which):
        if found.names != ("a", "b"):
            return {("a",): 80.0, ("b",): 20.0, (): 90.0}[found.names]
        return 1.0 + 9000.0 * abs(found.z[1] - self.cliff)

    def without(self, base, now, name):
        left = tuple(other for other in now.names if other != name)
        return RobotFit(left, np.zeros(len(left)), {}, 0.0)


@pytest.mark.parametrize(
    ("share", "taken"), [(0.125, ["a", "b"]), (-0.9375, ["a", "b"]), (1.5, ["b"]), (0, ["a", "b"])]
)
def test_next_to_falling_every_name_is_asked_for_at_sizes_a_little_aside(monkeypatch, share, taken):
    cliff = 1.0 + share * ENGINES_SHARE
    monkeypatch.setattr(Leaning, "cliff", cliff)
    monkeypatch.setattr(Given, "whole", dict.fromkeys([(), ("a",), ("b",), ("a", "b")], 1.0))
    placed = {n: effect_of(n) for n in "ab"}
    sight = SimpleNamespace(box=lambda names: (np.zeros(2), np.full(2, 9.0)))
    search = SimpleNamespace(
        model=SimpleNamespace(placed=placed, nuisances=()),
        sight=sight,
        replayed=lambda found: found,
    )
    own = Leaning(search, None, FITS, JUDGES, held_out=True)
    now = RobotFit(("a", "b"), np.ones(2), {}, 0.0)
    gains = [SimpleNamespace(name=n, deflated=20.0, held_out=None) for n in "ab"]
    found = SimpleNamespace(base=RobotFit((), np.zeros(0), {}, 0.0), fit=now, taken=gains, tried=())
    _, kept, after, _ = own.kept(found, lambda _: None)
    assert [gain.name for gain in kept] == taken
    if taken == ["a", "b"]:
        assert after.z == pytest.approx([1.0, cliff])


def test_no_size_is_beyond_what_an_effect_may_be():
    cliff = {0.0: 9.0, HALF: 1.4, WIDE: 1.3, -HALF: 6.0, -WIDE: 6.0}
    end = 2.0 * (1.0 + HALF)
    assert steep(2.0, cliff, high=end) == (["a"], [pytest.approx(end)])


def gain_of(name, nats):
    fit = RobotFit((name,), np.zeros(1), {}, -nats)
    return RobotGain(name, fit, nats, 1.0, None)


@pytest.mark.parametrize("by_volts", [True, False])
@pytest.mark.parametrize(
    ("denied", "kept"),
    [
        ({}, ["gain", "limit", "far"]),
        ({"gain": -0.9}, ["limit", "far"]),
        # what is far behind is no rival, and is not asked
        ({"gain": -0.9, "far": -0.9}, ["limit", "far"]),
        ({"supply": -0.5, "gain": -0.9}, ["gain", "limit", "far"]),
        ({"supply": -0.4, "gain": -0.9}, ["limit", "far"]),
    ],
)
def test_a_rival_that_servos_voltages_deny_is_none_unless_they_deny_the_name(
    monkeypatch, denied, kept, by_volts
):
    nats = {"supply": 60.0, "gain": 55.0, "limit": 50.0, "far": 60.0 - APART_NATS - 2.0 * CLOSE}
    step = tuple(gain_of(*pair) for pair in nats.items())
    later = (gain_of("tips", 40.0), gain_of("gain", 39.0))
    alike = {"supply": (("gain", 0.99), ("limit", 0.97)), "tips": ()}
    found = RobotFindings(BASE, step[0].fit, (step[0], later[0]), (step, later), alike, ())
    asked = []

    def volts_denied(self, fit):
        (name,) = fit.names
        asked.append(name)
        return denied.get(name, 0.0)

    by, other = ("volts_denied", "duties_denied")[:: 1 if by_volts else -1]
    monkeypatch.setattr(RobotJudges, by, volts_denied)
    monkeypatch.setattr(RobotJudges, other, lambda self, fit: 0.0)
    left = judges({}).undenied(found)
    assert [gain.name for gain in left.tried[0]] == ["supply", *kept]
    assert [name for name, _ in left.alike["supply"]] == [n for n in kept if n != "far"]
    assert [gain.name for gain in left.tried[1]] == (["tips"] if denied else ["tips", "gain"])
    assert "far" not in asked
    assert left.taken == found.taken


@pytest.mark.parametrize(
    ("names", "left"), [(("far",), ["supply", "far"]), (("far", "gain"), ["supply"])]
)
def test_a_rival_is_not_denied_for_what_another_name_would_answer(monkeypatch, names, left):
    """As a weight that was fitted alone, and a trunk that took its place beside a gain."""
    monkeypatch.setattr(RobotJudges, "volts_denied", lambda self, fit: 0.0)
    monkeypatch.setattr(RobotJudges, "duties_denied", lambda self, fit: 9.0 * ("far" in fit.names))
    beside = RobotFit(("supply", "gain"), np.zeros(2), {}, -60.0)
    rival = RobotGain("far", RobotFit(names, np.zeros(len(names)), {}, -58.0), 58.0, 1.0, None)
    named, later = RobotGain("supply", beside, 60.0, 1.0, None), gain_of("gain", 30.0)
    found = RobotFindings(BASE, beside, (named, later), ((named, rival), (later,)), {}, ())
    told = judges({}).undenied(found)
    assert [gain.name for gain in told.tried[0]] == left


@pytest.mark.parametrize(
    ("explainable", "squares", "volts", "share"),
    [
        (4e-6, (5e-6, 2e-6), (0.0, 0.0), 0.75),
        (4e-6, (2e-6, 9e-6), (-0.9, 0.0), -1.0),
        (4e-6, (9e-6, 2e-6), (0.0, -0.9), 1.0),
        (-1e-7, (5e-6, 2e-6), (-0.9, -0.3), 8.0 / 9.0),  # nothing but voltages shows it
        (-1e-7, (5e-6, 2e-6), (-0.1, -0.9), -1.0),
        (4e-6, (2e-6, 2.3e-6), (-0.9, -0.3), 8.0 / 9.0),  # tolerances take as much of positions
        (4e-6, (2e-6, 1.7e-6), (-0.9, -0.3), 8.0 / 9.0),
        (4e-6, (2e-6, 2.3e-6), (-0.9, -0.6), -0.075),  # and the name little of voltages
        (4e-6, (2e-6, 1.5e-6), (-0.9, -0.3), 0.125),
        (-1e-7, (5e-6, 2e-6), (0.0, 0.0), 0.0),  # nor do they, as nobody read any
    ],
)
def test_what_a_name_explains_is_of_positions_or_else_of_voltages(
    monkeypatch, explainable, squares, volts, share
):
    with_it = taken_as(1.0, 0.0, 0.0, 0.0)
    made = judges({})

    def of(pair):
        return lambda self, found, *_: pair[found is with_it]

    monkeypatch.setattr(RobotJudges, "square", of(squares))
    monkeypatch.setattr(RobotJudges, "volts_more", of(volts))
    monkeypatch.setattr(RobotJudges, "duties_denied", of((0.0, 0.0)))
    assert made.explained(BASE, with_it, explainable) == pytest.approx(share)


def test_where_duties_deny_the_model_a_name_explains_what_of_them_it_takes_away(monkeypatch):
    with_it = taken_as(1.0, 0.0, 0.0, 0.0)
    off = {True: 3.0, False: 9.0}
    monkeypatch.setattr(RobotJudges, "square", lambda self, found, *_: 2e-6)
    monkeypatch.setattr(RobotJudges, "volts_more", lambda self, found: 0.0)
    monkeypatch.setattr(RobotJudges, "duties_off", lambda self, found: off[found is with_it])
    assert judges({}).explained(BASE, with_it, -1e-7) == pytest.approx(8.0 / 9.0)
    off[False] = 0.9 * DUTIES_OFF  # which is no denial
    assert judges({}).explained(BASE, with_it, -1e-7) == 0.0


@pytest.mark.parametrize(
    ("before", "now", "explainable"),
    [
        (5.0, 2.0, 4.0),  # all above the floor, though some is left
        (5.0, 0.4, 4.6),  # what goes below that as well
        (0.9, 0.4, -0.1),  # nothing, where tolerances leave none
    ],
)
def test_what_can_be_explained_is_what_is_above_the_floor_and_what_goes_below_it(
    before, now, explainable
):
    own = Given(None, FITS, JUDGES, None, held_out=True)
    Given.phases = {(): before, ("a",): now}
    base, found = (SimpleNamespace(names=names) for names in ((), ("a",)))
    assert RobotJudges.explainable(own, base, found) == pytest.approx(explainable)
