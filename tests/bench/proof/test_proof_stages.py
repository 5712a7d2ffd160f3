"""What each part of the method buys: names at every stage, scored like answers."""

from judged_cases import diagnosis, effect, key

from bench.diagnosis.joint.search import NEEDED
from bench.proof.stages import STAGES, names_at, stages


def ranked(effect, gain_nats, deflated_nats, beside=()):
    return {
        "effect": effect,
        "gain_nats": gain_nats,
        "deflated_nats": deflated_nats,
        "with": list(beside),
    }


def answer(*causes, ranking=(), rejected=()):
    return diagnosis(*causes) | {
        "ranking": list(ranking),
        "rejected": [{"effect": name, "gain_nats": 9.0, "because": ""} for name in rejected],
    }


RANKING = (
    ranked("backlash", 90.0, NEEDED - 0.1),
    ranked("dead_zone", 50.0, NEEDED + 0.1),
    ranked("punch", 999.0, 999.0, beside=["dead_zone"]),
)


def test_the_best_alone_is_named_by_likelihood_and_after_deflation():
    names = names_at(answer(ranking=RANKING))
    assert names == {
        "likelihood": ("backlash",),
        "deflated": ("dead_zone",),
        "left_out": (),
        "answer": (),
    }
    few = names_at(answer(ranking=[ranked("backlash", NEEDED - 0.1, 1.0)]))
    assert few["likelihood"] == few["deflated"] == ()
    assert set(names) == set(STAGES)


def test_names_taken_back_stand_at_the_stage_before():
    told = answer(rejected=["cable_drag"])
    told["rejected"].append({"effect": "voltage_sag", "source_ohm": 1.0})  # never taken
    names = names_at(told)
    assert names["left_out"] == ("cable_drag",)
    assert names["answer"] == ()
    beside = told | {"details": {"taken_back": ["cable_drag", "punch"]}}  # one is told as a rival
    assert names_at(beside)["left_out"] == ("cable_drag", "punch")


def test_every_stage_is_scored_on_the_same_cases():
    zone = effect("dead_zone", margin_rad=(0.01, 0.0))
    cases = [
        (key("null"), answer(ranking=RANKING)),
        (key("single", zone), answer(ranking=RANKING)),
        (key("deleted", zone), answer(ranking=RANKING)),
        (key("single", zone), None),  # it failed
    ]
    rows = stages(cases)
    assert {stage: row["alarms"]["value"] for stage, row in rows.items()} == {
        "likelihood": 1.0,
        "deflated": 1.0,
        "left_out": 0.0,
        "answer": 0.0,
    }
    assert rows["likelihood"]["right"]["value"] == 0.0
    assert rows["deflated"]["right"]["value"] == 1.0
    assert rows["deflated"]["right"]["n"] == 1
    assert rows["deflated"]["wrong"]["value"] == 0.5  # what was deleted cannot be right


def test_whole_robots_are_no_part_of_it():
    rows = stages([(key("null") | {"rig": "marvin-walk"}, answer(ranking=RANKING))])
    assert rows["likelihood"]["alarms"]["n"] == 0
