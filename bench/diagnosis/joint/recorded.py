"""The recordings of one joint as replays, and what rollouts along them leave of what was recorded.

Registers are first put at the instants they were made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.drive import fields
from sim.rollout import Batch, Candidate

from ..commands import without_supply
from ..noise import Block
from ..observed import Channel, Observed
from .instants import located, looked_back
from .leash import path
from .left import Left, good

Floats = NDArray[np.float64]


class Recorded:
    """Recordings of a joint, along which candidates for it are rolled out.

    ``load_refresh_s`` is the period in which the duty's register is renewed, 0 for always;
    ``leash_rad_s`` is that of :mod:`.leash`, 0 for none.
    """

    def __init__(
        self, observed: Sequence[Observed], load_refresh_s: float, leash_rad_s: float
    ) -> None:
        self._observed, self._leash_rad_s = observed, leash_rad_s
        duties = [located(o, Channel.DUTY, load_refresh_s) for o in observed]
        volts = [located(o, Channel.VOLTAGE, o.volts_s) for o, _ in duties]
        #: with registers at the instants they were made
        shown = [looked_back(one) for one, _ in volts]
        paths = [path(o) if leash_rad_s else None for o in shown]
        self.replays = [replace(o.replay, path=way) for o, way in zip(shown, paths, strict=True)]
        self._batch = Batch(self.replays)
        self._sensed = [
            np.interp(o.replay.samples, o.position.t_s[o.position.good], good(o)) for o in shown
        ]
        self._left = [
            Left(one, renewed=bool(load_refresh_s) and at is None, made_s=at or 0.0, rail_s=rail)
            for one, (_, rail), (_, at) in zip(shown, volts, duties, strict=True)
        ]

    def run(
        self, candidates: Sequence[Candidate], replays: Sequence[int], sourced: bool
    ) -> list[Floats]:
        """Rollouts, under the recorded supply where there is one.

        ``sourced`` has all of them under that of their candidates.
        """
        supplied = [o.supplied for o in self._observed]
        if sourced and any(supplied):
            return list(self._sourced.run(candidates, replays, self._leash_rad_s))
        stiff = [
            replace(c, source_ohm=0.0) if supplied[r] and c.source_ohm else c
            for c, r in zip(candidates, replays, strict=True)
        ]
        return list(self._batch.run(stiff, replays, self._leash_rad_s))

    @cached_property
    def _sourced(self) -> Batch:
        """Replays without what a register told of a supply that was recorded."""
        told = zip(self.replays, self._observed, strict=True)
        return Batch([without_supply(one) if o.supplied else one for one, o in told])

    def regulate(self, candidates: Sequence[Candidate], replays: Sequence[int]) -> list[Floats]:
        """Duties of the controllers alone, along the recorded angles."""
        return self._batch.regulate(candidates, replays, [self._sensed[r] for r in replays])

    def law(self, candidate: Candidate, r: int, every_s: float) -> Floats:
        """The duty that firmware made of the recorded angles, every so many seconds from 0 on."""
        replay, position = self._observed[r].replay, self._observed[r].position
        t_s: Floats = np.arange(0.0, replay.end_s + every_s, every_s)
        angles = np.interp(t_s, position.t_s[position.good], good(self._observed[r]))
        batch = Batch([replace(replay, samples=t_s)], threads=1)
        duty: Floats = batch.regulate([candidate], [0], [angles])[0]
        return duty

    def blocks(
        self,
        r: int,
        channel: Channel,
        some: Sequence[Candidate],
        out: Floats,
        duty: Floats | None,
    ) -> list[Block]:
        """A block of one recording for each candidate's rollout; none where the channel is not."""
        source = np.array([c.source_ohm for c in some])
        voltage = np.array([c.voltage_v for c in some])
        late = np.array([c.drive[fields.DELAY] for c in some])
        return self._left[r].blocks(channel, out, duty, source, voltage, late)

    def floor(self, channel: Channel) -> float | None:
        """The least white deviation of a channel, its register's rounding; of none without it."""
        steps = [o.channels[channel].quantum for o in self._observed if channel in o.channels]
        return max(steps) / np.sqrt(12.0) if steps else None

    def between(self, r: int, t_s: Floats) -> Floats:
        """How far a duty may be off, as angles are known now and then: :meth:`Left.between`."""
        return self._left[r].between(t_s)
