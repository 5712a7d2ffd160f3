"""Fits of a whole robot: what nuisances do is linear, so each step is one weighted least squares.

The likelihood is that of one joint (:mod:`bench.diagnosis.noise`). A vector is the nuisances, each
in deviations of its prior and no farther than it may go, then the knobs of the effects that are on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..joint.confidence import sandwich, stretches
from ..joint.fit import bounded_step
from ..noise import Noise, cost, estimate, huber_weight, whiten
from .features import RobotKind
from .model import (
    LEAST_NOISE_RAD,
    VOLTAGE_FLOOR_V,
    VOLTAGE_SENSE,
    RobotBlocks,
    RobotModel,
)
from .regulated import DUTY_FLOOR

Floats = NDArray[np.float64]

STEP = 0.05  #: of a knob in finite differences, in its unit or its value
ROUNDS = 6  #: of fitting and of estimating the noise in turns, at most
STEPS = 4  #: of least squares in a round, at most
SHORTER = (1.0, 0.5, 0.2, 0.05)  #: shares of a step that are tried
KINDS_S = 1e5  #: between times of one kind of channel and of another, as far as those of joints
LASTING_S = 1e4  #: memory of what is the same in all of a recording
DUTY_NOISE = Noise(DUTY_FLOOR, 0.0, LASTING_S)
HELD = 1e9  #: what a prior knows of a number that is held
#: channels of registers: what all recordings tell once, or what no model of joints does wrong
REGISTERS = (RobotKind.VOLTAGE, RobotKind.DUTY)
ENOUGH = 0.3  #: gain [nats] at which a fit is done
#: times that priors count: all recordings tell the same of tolerances, and what engines differ by
#: with it, so that likelihoods are 2.6 to 5 times too sure, by which gains are divided
FIRM = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class RobotFit:
    """Effects by name and the likeliest vector with them; noise by kind; cost with priors."""

    names: tuple[str, ...]
    z: Floats
    noise: Mapping[RobotKind, Noise]
    cost: float  #: negative log-likelihood with the priors [nats]
    once: float = 0.0  #: that of registers in it, whose gains are not divided [nats]

    @property
    def knobs(self) -> Floats:
        """Values of the knobs."""
        return self.z[len(self.z) - len(self.names) :]

    @property
    def nuisances(self) -> Floats:
        """Values of the nuisances, in deviations."""
        return self.z[: len(self.z) - len(self.names)]

    @property
    def settings(self) -> tuple[tuple[str, float], ...]:
        """Effects with the values of their knobs."""
        return tuple(zip(self.names, self.knobs.tolist(), strict=True))


def voltage_noise(model: RobotModel, recordings: int) -> Noise:
    """Of a voltage [V] that so many recordings show: all of them together tell it once."""
    once = math.sqrt(recordings)
    level = VOLTAGE_SENSE * model.base.supply.voltage_v
    return Noise(VOLTAGE_FLOOR_V * once, level * once, LASTING_S)


class Sight:
    """Some recordings and kinds of channels of a model: what a fit is allowed to see.

    ``held`` are knobs that are known from elsewhere, by the names of their effects.
    """

    def __init__(self, model: RobotModel, which: Sequence[int], kinds: Iterable[RobotKind]) -> None:
        self.model, self.which = model, tuple(which)
        self.kinds = tuple(kind for kind in kinds if kind in model.floors())
        self.held: dict[str, float] = {}

    def blocks(
        self, names: Sequence[str], z: Floats, which: Sequence[int] | None = None
    ) -> RobotBlocks:
        """Recorded less modelled."""
        chosen = self.which if which is None else which
        found = self.model.residuals(names, z, chosen)
        return {key: block for key, block in found.items() if key[1] in self.kinds}

    def noise(
        self, blocks: RobotBlocks, start: Mapping[RobotKind, Noise] | None = None
    ) -> dict[RobotKind, Noise]:
        """The likeliest noise of every kind; of shaking, what engines differ by.

        They do so in every recording and leg alike, and so all of them together tell it once. The
        same is so of a voltage, which dividers of servos show too high or too low throughout.
        """
        floors = self.model.floors(LEAST_NOISE_RAD)
        found: dict[RobotKind, Noise] = {}
        for kind in self.kinds:
            own = [b for (_, k), b in blocks.items() if k is kind]
            if kind is RobotKind.SHAKING:
                repeats = len(own) * len(self.model.base.legs)
                found[kind] = Noise(floors[kind] * math.sqrt(repeats), 0.0, KINDS_S)
            elif kind is RobotKind.VOLTAGE:
                found[kind] = voltage_noise(self.model, len(own))
            elif kind is RobotKind.DUTY:
                found[kind] = DUTY_NOISE
            else:
                found[kind] = estimate(own, floors[kind], start.get(kind) if start else None)
        return found

    def cost(self, blocks: RobotBlocks, noise: Mapping[RobotKind, Noise]) -> float:
        """Negative log-likelihood without priors [nats]."""
        return sum(cost(block, noise[kind]) for (_, kind), block in blocks.items())

    def fit(
        self,
        names: Sequence[str] = (),
        start: Floats | None = None,
        noise: Mapping[RobotKind, Noise] | None = None,
        which: Sequence[int] | None = None,
        rounds: int = ROUNDS,
    ) -> RobotFit:
        """The likeliest vector with some effects, from ``start``."""
        z = np.zeros(len(self.model.nuisances) + len(names)) if start is None else start
        z = np.clip(z, *self.box(names))
        blocks = self.blocks(names, z, which)
        noise = noise or self.noise(blocks)
        best: RobotFit | None = None
        for _ in range(rounds):
            z, blocks = self._least_squares(names, z, noise, which)
            noise = self.noise(blocks, noise)
            found = self._found(names, z, blocks, noise)
            if best is not None and found.cost > best.cost - ENOUGH:
                return found if found.cost < best.cost else best
            best = found
        assert best is not None
        return best

    def at(self, found: RobotFit) -> RobotFit:
        """A fit as it is, its noise and cost told anew."""
        blocks = self.blocks(found.names, found.z)
        return self._found(found.names, found.z, blocks, self.noise(blocks, found.noise))

    def _found(
        self,
        names: Sequence[str],
        z: Floats,
        blocks: RobotBlocks,
        noise: Mapping[RobotKind, Noise],
    ) -> RobotFit:
        total = self.cost(blocks, noise) + self._prior(z, names)
        own = {key: block for key, block in blocks.items() if key[1] in REGISTERS}
        return RobotFit(tuple(names), z, noise, total, self.cost(own, noise))

    def box(self, names: Sequence[str]) -> tuple[Floats, Floats]:
        """The least and the greatest of every number; idle nuisances stay at 0, held knobs too."""
        own = [
            (0.0, 0.0) if {*n.same, *n.idle} & set(names) else n.ends for n in self.model.nuisances
        ]
        for name in names:
            known = self.held.get(name)
            own.append(self.model.placed[name].knob.bounds if known is None else (known, known))
        low, high = zip(*own, strict=True)
        return np.array(low), np.array(high)

    def _prior(self, z: Floats, names: Sequence[str]) -> float:
        return 0.5 * FIRM * float(np.sum(z[: len(z) - len(names)] ** 2))

    def _least_squares(
        self,
        names: Sequence[str],
        z: Floats,
        noise: Mapping[RobotKind, Noise],
        which: Sequence[int] | None,
    ) -> tuple[Floats, RobotBlocks]:
        low, high = self.box(names)
        prior = np.full(len(z), FIRM)
        prior[len(z) - len(names) :] = 0.0
        blocks = self.blocks(names, z, which)
        now = self.cost(blocks, noise) + self._prior(z, names)
        for _ in range(STEPS):
            residual, jacobian = self.linearised(names, z, noise, which)
            weight = huber_weight(residual)
            normal = (jacobian * weight[:, None]).T @ jacobian + np.diag(prior + 1e-9)
            slope = jacobian.T @ (weight * residual) + prior * z
            way = bounded_step(normal, slope, z, (low, high), "bvls")
            gained = 0.0
            for share in SHORTER:
                tried = np.clip(z + share * way, low, high)
                moved = self.blocks(names, tried, which)
                total = self.cost(moved, noise) + self._prior(tried, names)
                if total < now:
                    gained, now, z, blocks = now - total, total, tried, moved
                    break
            if gained < ENOUGH:
                break
        return z, blocks

    def linearised(
        self,
        names: Sequence[str],
        z: Floats,
        noise: Mapping[RobotKind, Noise],
        which: Sequence[int] | None = None,
    ) -> tuple[Floats, Floats]:
        """Whitened residual (n,) and its Jacobian (n, numbers), without priors."""
        blocks = self.blocks(names, z, which)
        count = len(z) - len(names)
        _, high = self.box(names)
        moved = []
        for k in range(count, len(z)):
            step = STEP * max(1.0, abs(z[k]))
            step = -step if z[k] + step > high[k] else step
            other = z.copy()
            other[k] += step
            moved.append((step, self.blocks(names, other, which)))
        residuals, rows = [], []
        for key, block in blocks.items():
            r, kind = key
            known = np.isfinite(self.model.recorded(r, kind))
            trace = self.model.traces[r][kind][known]
            knobs = [(b[key].value - block.value) / step for step, b in moved]
            columns = np.column_stack([block.value, -trace, *knobs])
            out, _ = whiten(block, noise[kind], np.ascontiguousarray(columns))
            residuals.append(out[:, 0])
            rows.append(out[:, 1:])
        return np.concatenate(residuals), np.concatenate(rows)

    def covariances(self, found: RobotFit) -> tuple[Floats, Floats]:
        """What the likelihood believes of a vector's errors, and what scores by stretch say."""
        residual, jacobian = self.linearised(found.names, found.z, found.noise)
        weight = huber_weight(residual)
        scores = jacobian * (weight * residual)[:, None]
        cluster = self._stretches(self.blocks(found.names, found.z))
        prior = np.full(len(found.z), FIRM)
        prior[len(found.z) - len(found.names) :] = 0.0
        low, high = self.box(found.names)
        free = low < high
        prior[~free] = HELD
        normal = (jacobian * weight[:, None]).T @ jacobian + np.diag(prior + 1e-9)
        believed = np.asarray(np.linalg.inv(normal), np.float64)
        # how far a truth is from 0 its prior says itself, however often that counts
        return believed, sandwich(believed, scores, cluster, np.where(free, FIRM * prior, prior))

    @staticmethod
    def _stretches(blocks: RobotBlocks) -> NDArray[np.intp]:
        """Number of the stretch of every row, block after block.

        A joint at a phase is one stretch in all recordings: what a model does wrong there it does
        wrong in each of them, and so they do not tell it as often as there are recordings.
        """
        kinds = list(RobotKind)
        own = [KINDS_S * kinds.index(kind) + block.t_s for (_, kind), block in blocks.items()]
        return stretches([np.concatenate(own)])

    def inflation(self, found: RobotFit, name: str) -> float:
        """How much too narrow the likelihood believes a knob to be, at least 1."""
        believed, shown = self.covariances(found)
        k = len(found.z) - len(found.names) + found.names.index(name)
        return max(1.0, float(shown[k, k] / believed[k, k]))

    def without(self, found: RobotFit, name: str, rounds: int = ROUNDS) -> RobotFit:
        """The fit again without one effect."""
        keep = [other != name for other in found.names]
        names = tuple(n for n, kept in zip(found.names, keep, strict=True) if kept)
        start = np.concatenate([found.nuisances, found.knobs[keep]])
        return self.fit(names, start, found.noise, rounds=rounds)
