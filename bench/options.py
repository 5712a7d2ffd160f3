"""Numbers on the command line: within their bounds, or refused in one line."""

from __future__ import annotations

from busemu.cli import fail

#: Longest walk [s]: a week.
LONGEST_S = 604_800.0
#: Seeds are those that any generator takes.
LARGEST_SEED = 2**32 - 1
#: More repeats than anybody waits for.
MOST_REPEATS = 1000
#: ``v_left`` and ``v_right``: far beyond any leg's reach, which is refused with its own words.
LARGEST_STRIDE = 100.0
#: Longest period of a control cycle [ms].
LONGEST_CYCLE_MS = 1000.0


def within(option: str, value: float, unit: str, low: float, high: float) -> None:
    """Fail unless ``low <= value <= high``, naming option, value, unit and bounds; NaN fails."""
    if not low <= value <= high:
        of = f" {unit}" if unit else ""
        fail(f"{option} must be {low:.10g} to {high:.10g}{of}, not {value:.10g}")


def steering_within(seconds: float, v_left: float, v_right: float, seed: int) -> None:
    """Fail unless a walk of these options is possible at all."""
    within("--seconds", seconds, "s", 0.1, LONGEST_S)
    within("--v-left", v_left, "(times the robot file's stride)", -LARGEST_STRIDE, LARGEST_STRIDE)
    within("--v-right", v_right, "(times the robot file's stride)", -LARGEST_STRIDE, LARGEST_STRIDE)
    within("--seed", seed, "", 0, LARGEST_SEED)
