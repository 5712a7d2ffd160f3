"""Scenario files: what they give, and what is said of mistakes in them."""

from __future__ import annotations

from pathlib import Path

import pytest
from fault_bench import FaultBench
from virtual_bus import XL

from busemu.chance import seeded
from busemu.faults import FaultError, Kind, load_scenario, parse_fault
from busemu.faults.fault import KEYS
from busemu.protocol import Instruction
from busemu.tables import load_robot

MARVIN = load_robot("marvin")
TOP = 'format = "busemu-faults/1"\n'


def scenario(tmp_path: Path, text: str):
    path = tmp_path / "faults.toml"
    path.write_text(text, "utf-8")
    return load_scenario(path, MARVIN)


def test_a_scenario_has_a_seed_and_faults_in_order(tmp_path):
    found = scenario(
        tmp_path,
        TOP
        + """
seed = 7
[[fault]]
kind = "drop"
servo = [3, 4]
instruction = "sync_read"
register = "present_position"
probability = 0.5
count = 3
[[fault]]
kind = "brown-out"
after_s = 2
""",
    )
    assert found.seed == 7
    drop, brown_out = found.faults
    assert (drop.kind, drop.servos, drop.count, drop.probability) == (Kind.DROP, (3, 4), 3, 0.5)
    assert drop.instruction is Instruction.SYNC_READ
    assert (brown_out.kind, brown_out.servos, brown_out.after_s) == (Kind.BROWN_OUT, (), 2.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[[fault]]\nkind = 'drop'", 'needs the line format = "busemu-faults/1"'),
        (TOP + "[[fault]", "not a TOML file"),
        (TOP + "sed = 3", "unknown key 'sed'"),
        (TOP + "seed = 'x'", "seed must be a whole number, not 'x'"),
        (TOP + "fault = 3", r"faults are listed as \[\[fault\]\]"),
        (TOP + "[[fault]]", r"\[\[fault\]\] 1: kind must be one of drop, .*missing"),
        (TOP + "[[fault]]\nkind = 'dorp'", "kind must be one of drop, .*not 'dorp'"),
        (TOP + "[[fault]]\nkind = 'drop'\nservo = 30", "servo 30 is not on marvin: its IDs are 1,"),
        (TOP + "[[fault]]\nkind = 'drop'\nservo = 'all'", "servo 'all' is not on marvin"),
        (
            TOP + "[[fault]]\nkind = 'drop'\nbits = 2",
            "drop has no 'bits': remove it, or use one of",
        ),
        (TOP + "[[fault]]\nkind = 'dead'\ncount = 2", "dead has no 'count'"),
        (
            TOP + "[[fault]]\nkind = 'drop'\nprobability = 1.5",
            "probability must be a number from 0",
        ),
        (TOP + "[[fault]]\nkind = 'drop'\ncount = 0", "count must be a whole number of 1 or more"),
        (TOP + "[[fault]]\nkind = 'drop'\ncount = true", "count must be a whole number"),
        (TOP + "[[fault]]\nkind = 'drop'\non = 'wire'", "on must be reply or instruction"),
        (TOP + "[[fault]]\nkind = 'delay'\ndelay_s = nan", "delay_s must be a number from 0 to 10"),
        (TOP + "[[fault]]\nkind = 'drop'\nregister = 'speed'", "XL-320 has no register 'speed'"),
        (TOP + "[[fault]]\nkind = 'drop'\ninstruction = 'reed'", "instruction must be one of ping"),
        (TOP + "[[fault]]\nkind = 'duplicate_id'\nservo = 3", "duplicate_id needs id"),
        (TOP + "[[fault]]\nkind = 'duplicate_id'\nid = 3", "duplicate_id needs one servo"),
        (TOP + "[[fault]]\nkind='drop'\n[[fault]]\nkind=1", r"\[\[fault\]\] 2: kind must be"),
    ],
)
def test_a_mistake_is_named_with_file_entry_rule_and_what_to_do(tmp_path, text, words):
    with pytest.raises(FaultError, match=words) as caught:
        scenario(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "faults.toml"))
    assert "\n" not in str(caught.value)


def test_a_scenario_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FaultError, match="No such file"):
        load_scenario(tmp_path / "none.toml", MARVIN)


def test_every_kind_has_its_keys_and_can_be_asked_for_with_nothing_but_what_it_needs():
    assert set(KEYS) == set(Kind)
    for kind in Kind:
        needs = {"servo": 2, "id": 1} if kind is Kind.DUPLICATE_ID else {}
        fault = parse_fault({"kind": kind.value, **needs}, "test", MARVIN)
        assert str(fault).startswith(kind.value.replace("_", "-"))


def test_every_kind_strikes_and_is_told():
    for kind in Kind:
        bench = FaultBench(XL)
        needs = {"servo": 2, "id": 1} if kind is Kind.DUPLICATE_ID else {}
        bench.have(kind.value, **needs)
        if kind is not Kind.UNPLUG:
            bench.read("present_position")
        assert bench.words[0].startswith(kind.value.replace("_", "-") + ": "), kind
        assert bench.faults.standing()[0].struck > 0


def test_the_words_of_a_fault_say_what_was_asked_for():
    fields = {"kind": "corrupt", "servo": 3, "bits": 2, "on": "instruction", "probability": 0.25}
    words = str(parse_fault(fields, "test", MARVIN))
    assert words == "corrupt servo 3, on instruction, bits 2, probability 0.25"


def test_each_fault_has_numbers_of_its_own_and_the_same_for_the_same_seed():
    first = [seeded(seed)(number).random() for seed in (1, 2) for number in (1, 2)]
    assert len(set(first)) == 4
    assert first == [seeded(seed)(number).random() for seed in (1, 2) for number in (1, 2)]
