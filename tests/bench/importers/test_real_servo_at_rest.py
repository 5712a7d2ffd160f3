"""What a real STS3215 does at rest is what the emulated one's law says, to a step of its register.

The logs are Robonine's: levers that others pull by elastic bands. No log tells its registers, so
each servo has the factory's values but for what is said here.
"""

import csv
from dataclasses import replace

import pytest
from foreign_logs import STEP_RAD, recordings

from bench.experiments.position_error import position_law
from busemu.plant import position_duty
from busemu.tables import load_table

STEP = 0.001  #: of the load register: share of full duty
FOR = 5  #: rows, a tenth of a second each, that goal and joint have stood still for


def at_rest(path, servo):
    """Error [counts] and load [share of full duty, sign of the duty] of every row at rest."""
    names = [f"{name} ({servo})" for name in ("target pos", "pos", "load")]
    with path.open(newline="") as file:
        told = [[row[n] for n in names] for row in csv.DictReader(file)]
    rows = [[int(cell) for cell in row] for row in told if all(row)]
    for k in range(FOR, len(rows)):
        if len({(goal, position) for goal, position, _ in rows[k - FOR : k + 1]}) == 1:
            goal, position, load = rows[k]
            yield goal - position, (load - 1024 if load >= 1024 else -load) * STEP


@pytest.mark.parametrize(
    ("log", "servo", "registers"),
    [
        ("nocomp2", 1, {}),
        ("nocomp2", 2, {}),
        ("single", 5, {"punch": 0}),
        ("comp2", 1, {"p_gain": 50}),
        ("comp2", 2, {"p_gain": 50}),
    ],
)
def test_the_duty_of_a_real_servo_at_rest_is_that_of_the_emulated_law(log, servo, registers):
    folder = recordings("robonine-sts3215-backlash", "logs")
    seen = list(at_rest(folder / f"motor_telemetry_{log}.csv", servo))
    assert len({error for error, _ in seen}) >= 3
    law = position_law(load_table("STS3215"), registers)
    for error, duty in seen:
        command = replace(law, goal_position_rad=error * STEP_RAD)
        assert duty == pytest.approx(position_duty(command, 0.0), abs=STEP)
