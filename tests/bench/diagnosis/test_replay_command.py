"""``busemu replay``, as a person types it, and what it says of a model that is right or wrong."""

import csv
import math
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w
from diagnosing import refused, written
from programs import busemu
from swinging import ROBOT, stuck, swings
from walking_robots import believed, marvin, recorded_walk

from bench.diagnosis.replaying import Misfit, replay
from bench.diagnosis.result import Estimate
from bench.diagnosis.robot.effects import placed_effects
from bench.diagnosis.robot.improved import of_causes, write_model
from bench.diagnosis.sense import DiagnosisError
from bench.recording import Recording
from busemu.tables import load_robot
from sim.effects import effect
from sim.model import Addition, with_additions
from sim.model import Estimate as Known

MORE_NM_S_RAD = effect("viscous_friction").parameter("more_nm_s_rad").typical
HALF_COUNT_RAD = math.pi / 4096.0


def silent(_):
    pass


@pytest.fixture(scope="module")
def rigid(tmp_path_factory):
    """The pendulum with a rigid gear, as the recordings were made."""
    text = load_robot(ROBOT).path.read_text()
    lines = [line for line in text.splitlines() if not line.startswith("gear_stiffness_nm_rad")]
    path = tmp_path_factory.mktemp("rigid") / "rigid.toml"
    path.write_text("\n".join(lines))
    return load_robot(path)


@pytest.fixture(scope="module")
def truer(rigid):
    """The same with the friction that was hidden in the recordings."""
    added = Addition(
        effect("viscous_friction"), ("arm",), {"more_nm_s_rad": Known(MORE_NM_S_RAD, "made up")}
    )
    path = rigid.path.with_name("model.toml")
    path.write_text(tomli_w.dumps(with_additions(rigid, [added])))
    return path


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Recordings with more viscous friction than the pendulum's file has."""
    return written(tmp_path_factory.mktemp("logs"), swings("viscous_friction", 1.0))


def test_what_the_very_model_made_is_replayed_within_rounding(rigid):
    found = replay([rigid], swings(), silent)
    assert len(found) == 4
    for one in found:
        assert Misfit.of([one], 0).largest <= 1.05 * HALF_COUNT_RAD


def test_the_model_with_the_friction_is_nearer(rigid, truer):
    found = replay([rigid, load_robot(truer)], swings("viscous_friction", 1.0), silent)
    assert Misfit.of(found, 0).rms > 5.0 * HALF_COUNT_RAD
    assert Misfit.of(found, 1).largest <= 1.05 * HALF_COUNT_RAD


def test_sizes_are_those_of_all_samples():
    (one, *_) = replay([load_robot(ROBOT)], swings("viscous_friction", 1.0), silent)
    left = np.abs(one.measured_rad - one.modelled_rad[0])
    misfit = Misfit.of([one], 0)
    assert misfit.samples == len(left)
    assert misfit.mean_absolute == pytest.approx(left.mean())
    assert misfit.rms == pytest.approx(math.sqrt((left**2).mean()))
    assert misfit.largest == left.max()


def test_a_walk_is_replayed_as_a_whole(tmp_path):
    tip = placed_effects(believed())["foot_compliance@all"]
    found = {tip.parameter.name: Estimate(600.0, (0.0, 1e6), "N/m")}
    write_model(marvin(), of_causes([(tip, found)], "made up"), tmp_path / "soft.toml")
    found = replay([marvin(), load_robot(tmp_path / "soft.toml")], [recorded_walk()], silent)
    assert [one.joint for one in found] == [mount.joint for mount in marvin().servos]
    right, wrong = (Misfit.of(found, which).rms for which in (0, 1))
    count = marvin().tables[1]["present_position"].si_scale
    assert right < 0.5 * count
    assert wrong > 1.5 * right


def test_the_command_leaves_a_table_and_a_picture_of_each(logs, truer, tmp_path):
    out = tmp_path / "out"
    done = busemu("replay", "--robot", ROBOT, "--robot", truer, "--out", out, logs[0].parent)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == {
        "replay.csv",
        *(f"{path.stem}.png" for path in logs),
    }
    with (out / "replay.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["robot"] for row in rows[:2]] == [ROBOT, str(truer)]
    assert len(rows) == 2 * len(logs)
    before, after = (np.array([float(row["rms_rad"]) for row in rows[k::2]]) for k in (0, 1))
    assert (after < before).all()
    for word in (*(path.stem for path in logs), "[mrad]", "all"):
        assert word in done.stdout


def test_robots_of_other_joints_are_refused(logs, tmp_path):
    text = load_robot(ROBOT).path.read_text()
    other = tmp_path / "other.toml"
    other.write_text(text.replace('"arm"', '"leg"'))
    with pytest.raises(DiagnosisError, match="files of one robot"):
        replay([load_robot(ROBOT), load_robot(other)], swings(), silent)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--robot", ROBOT, "--robot", ROBOT], "each robot file once"),
        (["--robot", "marvin"], "another robot"),
        (["--robot", "nothing"], "no robot named"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_line(words, said, logs):
    refused(busemu("replay", *words, logs[0]), said)


def light(tmp_path):
    """The bench with a horn that is next to nothing, on its gear."""
    text = load_robot("mx64-bench").path.read_text()
    path = tmp_path / "light.toml"
    path.write_text(text.replace("[1.0e-5, 2.0e-5, 1.0e-5]", "[1.0e-9, 2.0e-9, 1.0e-9]"))
    return load_robot(path)


def test_a_gear_that_no_replay_can_carry_is_told(tmp_path):
    rows = [
        SimpleNamespace(
            t_s=0.01 * k, t_reply_s=0.01 * k + 0.001, servo_id=1, op="read",
            register="present_position", raw=2048 + k,
        )
        for k in range(60)
    ]  # fmt: skip
    rows.append(
        SimpleNamespace(
            t_s=0.1, t_reply_s=math.nan, servo_id=1, op="write", register="goal_position", raw=2300
        )
    )
    told = Recording.of(
        rows, {"name": "one", "group": "one", "robot": "mx64-bench", "source": "simulation"}
    )
    assert replay([load_robot("mx64-bench")], [told], silent)
    with pytest.raises(DiagnosisError, match="too stiff for so light a load"):
        replay([light(tmp_path)], [told], silent)


def test_two_recordings_of_one_name_are_refused():
    with pytest.raises(DiagnosisError, match="two recordings are named"):
        replay([load_robot(ROBOT)], [*swings(), *swings()], silent)


def test_joints_that_never_move_as_told_are_no_replay():
    with pytest.raises(DiagnosisError, match="no joint moves"):
        replay([load_robot(ROBOT)], stuck(), silent)
