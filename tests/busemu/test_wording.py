"""Numbers in words: one is one, and anything else is several."""

import re
from dataclasses import replace

import pytest

from bench.running import describe
from busemu.wording import amount
from hal.walk import WalkReport


@pytest.mark.parametrize(
    ("count", "said"), [(0, "0 replies"), (1, "1 reply"), (2, "2 replies"), (21, "21 replies")]
)
def test_one_is_told_from_several(count, said):
    assert amount(count, "reply", "replies") == said


def test_a_walk_with_one_of_each_is_told_without_a_plural():
    one = replace(WalkReport(), cycles=1, missed_deadlines=1, lost_replies=1, clipped_goals=1)
    said = " ".join(describe(one))
    assert "1 missed deadline, 1 lost reply, 1 goal clipped" in said
    assert not re.search(r"\b1 [a-z ]*(cycles|deadlines|replies|goals)", said)
