"""How bodies on a free trunk accelerate: Featherstone's algorithms in the world's axes. Compiled.

Composite inertias make the mass matrix, a pass outward and one inward the forces that motion and
gravity make; a factor of the matrix that keeps to the tree's branches (Featherstone, Rigid Body
Dynamics Algorithms, 2008, tables 5.1, 6.2, 6.3 and 6.5, with all bodies' coordinates about one
point, so that nothing is transformed from body to body).
"""

from __future__ import annotations

import math

from ..compiling import compiled, inlined
from ..drive.fields import Array
from .arrays import AT, AXIS, CENTRE, FREE, INERTIA, MASS, YAW, Motion, Tree, Work


@inlined
def joint_frame(out: Array, parent: Array, column: Array, angle: float) -> None:
    """A body's frame: its parent's, turned by its yaw and then about its axis."""
    x, y, z = column[AXIS], column[AXIS + 1], column[AXIS + 2]
    c, s = math.cos(angle), math.sin(angle)
    d = 1.0 - c
    a, b = column[YAW], column[YAW + 1]
    # columns of the turn about the axis, then of both turns
    r00, r10, r20 = c + d * x * x, d * x * y + s * z, d * x * z - s * y
    r01, r11, r21 = d * x * y - s * z, c + d * y * y, d * y * z + s * x
    r02, r12, r22 = d * x * z + s * y, d * y * z - s * x, c + d * z * z
    t00, t10 = a * r00 - b * r10, b * r00 + a * r10
    t01, t11 = a * r01 - b * r11, b * r01 + a * r11
    t02, t12 = a * r02 - b * r12, b * r02 + a * r12
    for i in range(3):
        p, q, r = parent[i, 0], parent[i, 1], parent[i, 2]
        out[i, 0] = p * t00 + q * t10 + r * r20
        out[i, 1] = p * t01 + q * t11 + r * r21
        out[i, 2] = p * t02 + q * t12 + r * r22


@inlined
def about_origin(out: Array, frame: Array, place: Array, column: Array) -> None:
    """A body's inertia about the origin: mass, mass times centre, tensor."""
    m = column[MASS]
    cx, cy, cz = column[CENTRE], column[CENTRE + 1], column[CENTRE + 2]
    x = place[0] + frame[0, 0] * cx + frame[0, 1] * cy + frame[0, 2] * cz
    y = place[1] + frame[1, 0] * cx + frame[1, 1] * cy + frame[1, 2] * cz
    z = place[2] + frame[2, 0] * cx + frame[2, 1] * cy + frame[2, 2] * cz
    xx, yy, zz = column[INERTIA], column[INERTIA + 1], column[INERTIA + 2]
    xy, xz, yz = column[INERTIA + 3], column[INERTIA + 4], column[INERTIA + 5]
    out[0], out[1], out[2], out[3] = m, m * x, m * y, m * z
    for k in range(6):
        i, j = (k, k) if k < 3 else ((0, 1) if k == 3 else ((0, 2) if k == 4 else (1, 2)))
        a, b, c = frame[i, 0], frame[i, 1], frame[i, 2]
        d, e, f = frame[j, 0], frame[j, 1], frame[j, 2]
        turned = a * (xx * d + xy * e + xz * f)
        turned += b * (xy * d + yy * e + yz * f) + c * (xz * d + yz * e + zz * f)
        out[4 + k] = turned
    out[4] += m * (y * y + z * z)
    out[5] += m * (x * x + z * z)
    out[6] += m * (x * x + y * y)
    out[7] -= m * x * y
    out[8] -= m * x * z
    out[9] -= m * y * z


@inlined
def momentum(
    inertia: Array, wx: float, wy: float, wz: float, vx: float, vy: float, vz: float
) -> tuple[float, float, float, float, float, float]:
    """What an inertia makes of a spatial motion: angular part, then linear."""
    m, cx, cy, cz = inertia[0], inertia[1], inertia[2], inertia[3]
    xx, yy, zz = inertia[4], inertia[5], inertia[6]
    xy, xz, yz = inertia[7], inertia[8], inertia[9]
    return (
        xx * wx + xy * wy + xz * wz + cy * vz - cz * vy,
        xy * wx + yy * wy + yz * wz + cz * vx - cx * vz,
        xz * wx + yz * wy + zz * wz + cx * vy - cy * vx,
        m * vx + wy * cz - wz * cy,
        m * vy + wz * cx - wx * cz,
        m * vz + wx * cy - wy * cx,
    )


@compiled
def place_bodies(tree: Tree, motion: Motion, work: Work) -> None:
    """Frames, joints' screws and inertias of all bodies at the present angles."""
    frames, places, screws = work.frames, work.places, work.screws
    for i in range(3):
        places[0, i] = 0.0
        for j in range(3):
            frames[0, i, j] = motion.turned[i, j]
    about_origin(work.inertias[0], frames[0], places[0], tree.bodies[:, 0])
    for b in range(1, len(tree.parent)):
        k, column = tree.parent[b], tree.bodies[:, b]
        upper = frames[k]
        for i in range(3):
            places[b, i] = places[k, i] + (
                upper[i, 0] * column[AT]
                + upper[i, 1] * column[AT + 1]
                + upper[i, 2] * column[AT + 2]
            )
        joint_frame(frames[b], upper, column, motion.angle[b])
        frame, place, screw = frames[b], places[b], screws[b]
        for i in range(3):
            screw[i] = (
                frame[i, 0] * column[AXIS]
                + frame[i, 1] * column[AXIS + 1]
                + frame[i, 2] * column[AXIS + 2]
            )
        screw[3] = place[1] * screw[2] - place[2] * screw[1]
        screw[4] = place[2] * screw[0] - place[0] * screw[2]
        screw[5] = place[0] * screw[1] - place[1] * screw[0]
        about_origin(work.inertias[b], frame, place, column)


@compiled
def bias_forces(tree: Tree, motion: Motion, work: Work) -> None:
    """``work.push`` is what motion and gravity ask of every dof where nothing accelerates."""
    speeds, pulls = work.speeds, work.pulls
    count = len(tree.parent)
    for i in range(6):
        speeds[0, i] = motion.pace[i]
        pulls[0, i] = 0.0 if i < 3 else -tree.gravity[i - 3]
    for b in range(count):
        v, a = speeds[b], pulls[b]
        if b > 0:
            k, pace, s = tree.parent[b], motion.pace[FREE + b - 1], work.screws[b]
            for i in range(6):
                v[i] = speeds[k, i] + s[i] * pace
            # a = a of the parent + v x s pace
            u, w = pulls[k], speeds[k]
            a[0] = u[0] + (w[1] * s[2] - w[2] * s[1]) * pace
            a[1] = u[1] + (w[2] * s[0] - w[0] * s[2]) * pace
            a[2] = u[2] + (w[0] * s[1] - w[1] * s[0]) * pace
            a[3] = u[3] + (w[1] * s[5] - w[2] * s[4] + w[4] * s[2] - w[5] * s[1]) * pace
            a[4] = u[4] + (w[2] * s[3] - w[0] * s[5] + w[5] * s[0] - w[3] * s[2]) * pace
            a[5] = u[5] + (w[0] * s[4] - w[1] * s[3] + w[3] * s[1] - w[4] * s[0]) * pace
        n0, n1, n2, f0, f1, f2 = momentum(work.inertias[b], v[0], v[1], v[2], v[3], v[4], v[5])
        g0, g1, g2, h0, h1, h2 = momentum(work.inertias[b], a[0], a[1], a[2], a[3], a[4], a[5])
        a[6] = g0 + v[1] * n2 - v[2] * n1 + v[4] * f2 - v[5] * f1
        a[7] = g1 + v[2] * n0 - v[0] * n2 + v[5] * f0 - v[3] * f2
        a[8] = g2 + v[0] * n1 - v[1] * n0 + v[3] * f1 - v[4] * f0
        a[9] = h0 + v[1] * f2 - v[2] * f1
        a[10] = h1 + v[2] * f0 - v[0] * f2
        a[11] = h2 + v[0] * f1 - v[1] * f0
    for b in range(count - 1, 0, -1):
        total = 0.0
        for i in range(6):
            total += work.screws[b, i] * pulls[b, 6 + i]
            pulls[tree.parent[b], 6 + i] += pulls[b, 6 + i]
        work.push[FREE + b - 1] = total
    for i in range(6):
        work.push[i] = pulls[0, 6 + i]


@compiled
def mass_matrix(tree: Tree, work: Work) -> None:
    """``work.mass``, its lower triangle on the tree's branches; inertias become composite."""
    inertias, screws, mass = work.inertias, work.screws, work.mass
    for b in range(len(tree.parent) - 1, 0, -1):
        for i in range(10):
            inertias[tree.parent[b], i] += inertias[b, i]
        s = screws[b]
        force = momentum(inertias[b], s[0], s[1], s[2], s[3], s[4], s[5])
        row = FREE + b - 1
        k = b
        while k > 0:
            t = screws[k]
            mass[row, FREE + k - 1] = (t[0] * force[0] + t[1] * force[1] + t[2] * force[2]) + (
                t[3] * force[3] + t[4] * force[4] + t[5] * force[5]
            )
            k = tree.parent[k]
        for i in range(6):
            mass[row, i] = force[i]
    whole = inertias[0]
    m, x, y, z = whole[0], whole[1], whole[2], whole[3]
    for i in range(6):
        for j in range(i + 1):
            mass[i, j] = 0.0
    mass[0, 0], mass[1, 1], mass[2, 2] = whole[4], whole[5], whole[6]
    mass[1, 0], mass[2, 0], mass[2, 1] = whole[7], whole[8], whole[9]
    mass[3, 3] = mass[4, 4] = mass[5, 5] = m
    mass[3, 1], mass[3, 2] = z, -y
    mass[4, 0], mass[4, 2] = -z, x
    mass[5, 0], mass[5, 1] = y, -x


@inlined
def above(tree: Tree, dof: int) -> int:
    """The dof next to the root, -1 at it."""
    if dof <= FREE:
        return dof - 1
    parent = tree.parent[dof - FREE + 1]
    return int(FREE + parent - 1)


@compiled
def factor(tree: Tree, work: Work, free: bool) -> None:
    """The mass matrix becomes L, with L' L the matrix; that of the joints alone if not ``free``."""
    mass = work.mass
    last = 0 if free else FREE
    for k in range(len(mass) - 1, last - 1, -1):
        root = math.sqrt(mass[k, k])
        mass[k, k] = root
        i = above(tree, k)
        while i >= last:
            mass[k, i] /= root
            i = above(tree, i)
        i = above(tree, k)
        while i >= last:
            j = i
            while j >= last:
                mass[i, j] -= mass[k, i] * mass[k, j]
                j = above(tree, j)
            i = above(tree, i)


@compiled
def solve_down(tree: Tree, work: Work, x: Array, dof: int, free: bool) -> None:
    """``x`` becomes the inverse of L' times it; ``dof``: all beyond it are 0."""
    mass = work.mass
    last = 0 if free else FREE
    for k in range(dof, last - 1, -1):
        if x[k] == 0.0:
            continue
        x[k] /= mass[k, k]
        j = above(tree, k)
        while j >= last:
            x[j] -= mass[k, j] * x[k]
            j = above(tree, j)


@compiled
def solve_up(tree: Tree, work: Work, x: Array, free: bool) -> None:
    """``x`` becomes the inverse of L times it."""
    mass = work.mass
    last = 0 if free else FREE
    for k in range(last, len(mass)):
        total = x[k]
        j = above(tree, k)
        while j >= last:
            total -= mass[k, j] * x[j]
            j = above(tree, j)
        x[k] = total / mass[k, k]
    for k in range(last):
        x[k] = 0.0
