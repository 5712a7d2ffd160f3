"""The adapter's way up to the host, where bytes may be late, or lost."""

from __future__ import annotations

import math

from ..timing import Profile, Uplink


class FaultyUplink(Uplink):
    """Takes the place of the uplink ``before``, and what that one holds."""

    def __init__(self, profile: Profile, before: Uplink) -> None:
        super().__init__(profile)
        vars(self).update(vars(before))
        self.hold_s = 0.0  #: the next bytes are so much late [s]
        self._away = False
        self._free_s = -math.inf

    def carry(self, data: bytes, start_s: float, byte_s: float) -> None:
        """Take bytes whose first one begins on the wire at ``start_s``."""
        if self._away:
            return
        up_s = max(start_s + self.hold_s, self._free_s)
        if up_s > start_s:  # what comes after them has to stay behind them
            self._free_s = up_s + len(data) * byte_s
        self.hold_s = 0.0
        super().carry(data, up_s, byte_s)

    def unplug(self) -> None:
        """Lose all, and what comes."""
        self._away = True
        self.poll(math.inf)

    def replug(self) -> None:
        """Take bytes again."""
        self._away = False
        self._free_s = -math.inf
