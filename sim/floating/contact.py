"""What the ground and the joints' stops do to a robot within one step. Compiled.

Impulses are those that leave every contact's speed no deeper in the ground than a spring and a
damper let it (rigid: than it was, less a share), within a cone of friction: found one after the
other until none changes (projected Gauss and Seidel). A spring and a damper act as at the end of
the step, so that any stiffness is stable.

No foot is a point: one that turns on its spot rubs, and what friction does against that it does not
do against sliding. Both share one cone, of a patch that rubs at an arm about its middle. Nothing
bounces: a file's ``restitution`` is for PyBullet alone.
"""

from __future__ import annotations

import math

from ..compiling import compiled, inlined
from ..drive.fields import Array
from .arrays import (
    A_CONTACT,
    DAMPING,
    FREE,
    FRICTION,
    LOWER,
    NORMAL,
    PLACE,
    RADIUS,
    REACH,
    ROWS,
    STIFFNESS,
    TURNING,
    UPPER,
    Motion,
    Tree,
    Work,
)
from .dynamics import above, solve_down

NEAR_M = 0.002  #: above the ground, from which a point is looked at; a step is a tenth of it
GIVE_BACK = 0.2  #: share of a depth in rigid ground that a step gives back; as Bullet does
ROUNDS = 20  #: of the search for impulses, at most
TRIES = 6  #: of the search for a contact's friction in one round
CLOSE = 1e-6  #: share by which friction may be more than its limit
NONE = 1e-12  #: share of a contact's coupling that is none: a foot on a point turns freely
STILL_M_S = 1e-6  #: change of a contact's speed in one round below which the search ends
# terms of rows
TARGET, SOFT, SPEED, IMPULSE, RUB, SLIDES = 0, 1, 2, 3, 4, 5
NORMALLY = 3  #: row of a contact, after those of sliding along x and y and of turning


@inlined
def lowest(tree: Tree, work: Work, p: int, out: Array) -> None:
    """The lowest place of what can touch, about the origin [m]."""
    b = tree.owner[p]
    frame, column = work.frames[b], tree.points[:, p]
    radius = column[RADIUS]
    for i in range(3):
        out[i] = work.places[b, i] + (
            frame[i, 0] * column[PLACE]
            + frame[i, 1] * column[PLACE + 1]
            + frame[i, 2] * column[PLACE + 2]
        )
    x, y, z = column[NORMAL], column[NORMAL + 1], column[NORMAL + 2]
    if x == 0.0 and y == 0.0 and z == 0.0:
        out[2] -= radius
        return
    lean = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
    flat = math.sqrt(max(1e-12, 1.0 - lean * lean))
    for i in range(3):
        turned = frame[i, 0] * x + frame[i, 1] * y + frame[i, 2] * z
        down = lean * turned - (1.0 if i == 2 else 0.0)
        out[i] += radius * down / flat


@inlined
def touch_rows(tree: Tree, work: Work, b: int, at: Array, row: int) -> None:
    """Four rows of how a body's place moves with all dofs: along x, y, about z, along z.

    That about z is of where its patch rubs, so that it is a length as well.
    """
    arm = tree.bodies[TURNING, b]
    for i in range(A_CONTACT):
        for j in range(work.rows.shape[1]):
            work.rows[row + i, j] = 0.0
    work.rows[row, 3] = work.rows[row + 1, 4] = work.rows[row + 3, 5] = 1.0
    work.rows[row + 2, 2] = arm
    x, y, z = at[0], at[1], at[2]
    # a turn w moves it by w x at
    work.rows[row, 1], work.rows[row, 2] = z, -y
    work.rows[row + 1, 0], work.rows[row + 1, 2] = -z, x
    work.rows[row + 3, 0], work.rows[row + 3, 1] = y, -x
    k = b
    while k > 0:
        s, j = work.screws[k], FREE + k - 1
        work.rows[row, j] = s[3] + s[1] * z - s[2] * y
        work.rows[row + 1, j] = s[4] + s[2] * x - s[0] * z
        work.rows[row + 2, j] = arm * s[2]
        work.rows[row + 3, j] = s[5] + s[0] * y - s[1] * x
        k = tree.parent[k]


@inlined
def speed_of(work: Work, row: int, pace: Array) -> float:
    """How fast a row moves."""
    total = 0.0
    for j in range(len(pace)):
        total += work.rows[row, j] * pace[j]
    return total


@compiled
def gather(tree: Tree, motion: Motion, work: Work, pace: Array, step_s: float, free: bool) -> int:
    """Fill the rows of all that touches or may within the step; how many there are.

    ``pace``: of all dofs at the end of the step if nothing touched. Rows are kept by the factor's
    inverse, so that two rows' product is how the one's impulse moves the other.
    """
    terms, count, at = work.terms, 0, work.pulls[0]
    for p in range(len(tree.owner)):
        b = tree.owner[p]
        if not free or motion.origin[2] + work.places[b, 2] > tree.bodies[REACH, b] + NEAR_M:
            for i in range(A_CONTACT):
                motion.impulse[i, p] = 0.0
            continue
        lowest(tree, work, p, at)
        gap = motion.origin[2] + at[2]
        if gap > NEAR_M or count + A_CONTACT > ROWS:
            for i in range(A_CONTACT):
                motion.impulse[i, p] = 0.0
            continue
        touch_rows(tree, work, b, at, count)
        stiff, damp = tree.bodies[STIFFNESS, b], tree.bodies[DAMPING, b]
        back, soft = GIVE_BACK, 0.0
        if stiff < math.inf:
            back = step_s * stiff / (step_s * stiff + damp)
            soft = 1.0 / (step_s * (step_s * stiff + damp))
        terms[TARGET, count + NORMALLY] = -gap / step_s * (1.0 if gap > 0.0 else back)
        terms[SOFT, count + NORMALLY] = soft
        terms[RUB, count], terms[SLIDES, count] = tree.bodies[FRICTION, b], 0.0
        for i in range(A_CONTACT):
            terms[SPEED, count + i] = speed_of(work, count + i, pace)
            terms[IMPULSE, count + i] = motion.impulse[i, p]
            work.which[count + i] = p
        count += A_CONTACT
    for b in range(1, len(tree.parent)):
        under = motion.angle[b] - tree.bodies[LOWER, b]
        over = tree.bodies[UPPER, b] - motion.angle[b]
        room, sign = (under, 1.0) if under < over else (over, -1.0)
        if room + step_s * sign * pace[FREE + b - 1] > 0.0 or count >= ROWS:
            continue
        for j in range(work.rows.shape[1]):
            work.rows[count, j] = 0.0
        work.rows[count, FREE + b - 1] = sign
        terms[TARGET, count] = -room / step_s * (1.0 if room > 0.0 else GIVE_BACK)
        terms[SOFT, count] = terms[IMPULSE, count] = 0.0
        terms[SPEED, count] = sign * pace[FREE + b - 1]
        work.which[count] = -1 - b
        count += 1
    return count


@compiled
def couple(tree: Tree, work: Work, count: int, free: bool) -> None:
    """How the impulses of rows move each other: ``work.coupling``."""
    rows, coupling = work.rows, work.coupling
    for r in range(count):
        which = work.which[r]
        body = -1 - which if which < 0 else tree.owner[which]
        solve_down(tree, work, rows[r], FREE + body - 1, free)
        for s in range(r + 1):
            total = 0.0
            for j in range(FREE):
                total += rows[r, j] * rows[s, j]
            j = FREE + body - 1
            while j >= FREE:
                total += rows[r, j] * rows[s, j]
                j = above(tree, j)
            coupling[r, s] = coupling[s, r] = total


@inlined
def moved_by(work: Work, count: int, row: int) -> float:
    """A row's speed with all impulses."""
    total: float = work.terms[SPEED, row]
    for s in range(count):
        total += work.coupling[row, s] * work.terms[IMPULSE, s]
    return total


@compiled
def press(work: Work, count: int) -> None:
    """Find the impulses of all rows."""
    terms, coupling = work.terms, work.coupling
    for _ in range(ROUNDS):
        most = 0.0
        r = 0
        while r < count:
            contact = work.which[r] >= 0
            n = r + NORMALLY if contact else r
            soft, was = terms[SOFT, n], terms[IMPULSE, n]
            miss = terms[TARGET, n] - moved_by(work, count, n) - soft * was
            now = max(0.0, was + miss / (coupling[n, n] + soft))
            terms[IMPULSE, n] = now
            most = max(most, abs(now - was) * coupling[n, n])
            if contact:
                most = max(most, rub(work, count, r, terms[RUB, r] * now))
            r = n + 1
        if most < STILL_M_S:
            return


@inlined
def rub(work: Work, count: int, r: int, limit: float) -> float:
    """Friction of one contact, no more than its limit [N s]; the speed that changes by it.

    It stops what slides and turns if it can. If not it is as large as it may be and against where
    the contact goes then: the impulse ``l`` with ``(A + m) l = -v``, ``A`` the contact's own
    coupling, ``v`` its speed without it, and the ``m`` of 0 or more that makes it so large (J. J.
    More and D. C. Sorensen, Computing a trust region step, 1983).
    """
    terms, coupling = work.terms, work.coupling
    x, y, z = terms[IMPULSE, r], terms[IMPULSE, r + 1], terms[IMPULSE, r + 2]
    a, b, c = coupling[r, r], coupling[r + 1, r], coupling[r + 2, r]
    d, e, f = coupling[r + 1, r + 1], coupling[r + 2, r + 1], coupling[r + 2, r + 2]
    u = moved_by(work, count, r) - (a * x + b * y + c * z)
    v = moved_by(work, count, r + 1) - (b * x + d * y + e * z)
    w = moved_by(work, count, r + 2) - (c * x + e * y + f * z)
    none = NONE * (a + d)
    p, q, s, m = 0.0, 0.0, 0.0, max(none, terms[SLIDES, r])
    for _ in range(TRIES if limit > 0.0 else 0):
        # A + m is L L'; the impulse, and by how much it falls as m grows
        l00 = math.sqrt(a + m)
        l10, l20 = b / l00, c / l00
        l11 = math.sqrt(max(none, d + m - l10 * l10))
        l21 = (e - l20 * l10) / l11
        l22 = math.sqrt(max(none, f + m - l20 * l20 - l21 * l21))
        g = -u / l00
        h = (-v - l10 * g) / l11
        k = (-w - l20 * g - l21 * h) / l22
        s = k / l22
        q = (h - l21 * s) / l11
        p = (g - l10 * q - l20 * s) / l00
        size = math.sqrt(p * p + q * q + s * s)
        if abs(size - limit) < CLOSE * limit or (size < limit and m == none):
            break
        g = p / l00
        h = (q - l10 * g) / l11
        k = (s - l20 * g - l21 * h) / l22
        m = max(none, m + size * size / (g * g + h * h + k * k) * (size / limit - 1.0))
    size = math.sqrt(p * p + q * q + s * s)
    if size > limit > 0.0:
        p, q, s = p * limit / size, q * limit / size, s * limit / size
    terms[SLIDES, r] = m
    terms[IMPULSE, r], terms[IMPULSE, r + 1], terms[IMPULSE, r + 2] = p, q, s
    changed: float = max(abs(p - x) * a, abs(q - y) * d, abs(s - z) * f)
    return changed


@compiled
def pass_on(tree: Tree, motion: Motion, work: Work, count: int) -> None:
    """``work.push`` is the impulses' part of all dofs, by the factor's inverse."""
    for j in range(len(work.push)):
        work.push[j] = 0.0
    for r in range(count):
        impulse, p = work.terms[IMPULSE, r], work.which[r]
        if p >= 0:
            motion.impulse[r - first_of(work, r), p] = impulse
        if impulse != 0.0:
            for j in range(len(work.push)):
                work.push[j] += impulse * work.rows[r, j]


@inlined
def first_of(work: Work, r: int) -> int:
    """The first row of a row's contact; contacts come before stops."""
    return r - r % A_CONTACT
