"""Sine, cosine and decay that the compiler makes vectors of: the C library has them one by one."""

from __future__ import annotations

import math

import numpy as np

from ..compiling import inlined

QUARTERS = 2.0 / math.pi  #: in a radian
#: a quarter of a turn in two parts [rad]; the first has 33 bits, so that its multiples are exact
QUARTER = float.fromhex("0x1.921fb544p+0")
QUARTER_REST = 6.077100506506192e-11
GONE = 40.0  #: what decays no further: 4e-18 is left
HALVINGS = 8  #: of what decays, until a short series has it
HALVED = 2.0**-HALVINGS


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle [rad], to 3e-16 within a thousand turns."""
    quarters = np.floor(angle * QUARTERS + 0.5)
    x = (angle - quarters * QUARTER) - quarters * QUARTER_REST
    y = -x * x
    sine = cosine = 1.0
    for n in range(16, 0, -2):  # Taylor's series, from its smallest terms up
        sine = 1.0 + sine * y * (1.0 / (n * (n + 1)))
        cosine = 1.0 + cosine * y * (1.0 / (n * (n - 1)))
    sine *= x
    quadrant = quarters - 4.0 * np.floor(0.25 * quarters)
    if abs(quadrant - 2.0) == 1.0:
        sine, cosine = cosine, sine
    if quadrant >= 2.0:
        sine = -sine
    if abs(quadrant - 1.5) == 0.5:
        cosine = -cosine
    return sine, cosine


@inlined
def decay(x: float) -> float:
    """``exp(-x)`` of an ``x`` that is not negative, to 1e-13 of it or 4e-18."""
    y = min(x, GONE) * HALVED
    left = 1.0
    for n in range(11, 0, -1):
        left = 1.0 - left * y * (1.0 / n)
    for _ in range(HALVINGS):
        left *= left
    return left
