"""What a name does to recordings that were not used to fit, on squares that are given."""

import pytest

from bench.diagnosis.joint.search import HARM, Outside
from bench.diagnosis.joint.settling import HARMFUL, NEEDLESS, SPOILT, WORSE, spoils

FLOOR = 1e-3
NOISE = FLOOR**2


def outside(harm, relief=0.0):
    return Outside(nats=20.0, relief=relief, harm=harm)


@pytest.mark.parametrize(
    ("without", "with_it", "seen", "expected"),
    [
        (0.7 * NOISE, 0.8 * NOISE, outside(0.1), NEEDLESS),
        (0.7 * NOISE, 0.72 * NOISE, outside(2.0), None),  # hardly worse, and so not in doubt
        (0.7 * NOISE, 0.6 * NOISE, outside(0.0, 0.1), None),
        (0.7 * NOISE, 0.8 * NOISE, outside(0.1, 0.5), None),  # a current that it explains
        (4.0 * NOISE, 4.1 * NOISE, outside(0.1), None),
        (4.0 * NOISE, 1.01 * WORSE * 4.0 * NOISE, outside(1.01 * HARM), HARMFUL),
    ],
    ids=["needless", "hardly worse", "better", "in another channel", "beyond noise", "harmful"],
)
def test_what_a_name_does_to_recordings_that_were_not_fitted(without, with_it, seen, expected):
    assert spoils(without, with_it, NOISE, seen, FLOOR) == expected


def test_harm_counts_beside_what_a_name_mends():
    spoilt = 2.0 * NOISE
    for mended, expected in ((0.9 * spoilt / SPOILT, HARMFUL), (1.1 * spoilt / SPOILT, None)):
        found = spoils(4.0 * NOISE, 4.0 * NOISE + spoilt, mended, outside(2.0), FLOOR)
        assert found == expected
