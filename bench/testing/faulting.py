"""What a test lets go wrong on its bus: ``faults.drop(servo=3, count=2)``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from busemu.faults import FaultError, Standing


class BusFaults:
    """Faults of a bus. Each method gives the fault's number, for :meth:`clear` and :meth:`struck`.

    Faults of packets (drop to latency) take ``servo`` (an ID or a list of them), ``register``,
    ``instruction`` ("sync_read"), ``count``, ``probability``, ``after_s`` and ``for_s``; those
    that can strike the instruction as well take ``on="instruction"``. The others take ``servo``
    (``duplicate_id`` needs one), ``after_s`` and, but for ``overload``, ``for_s``. Times are
    from now on, in seconds of the bus. What is wrong with a request raises
    :class:`busemu.faults.FaultError`.
    """

    def __init__(self, ask: Callable[..., Mapping[str, Any]]) -> None:
        self._ask_bus = ask

    def _ask(self, **asked: Any) -> Mapping[str, Any]:
        answer = self._ask_bus(**asked)
        if "error" in answer:
            raise FaultError(answer["error"])
        return answer

    def add(self, kind: str, **fields: Any) -> int:
        """A fault of any kind, as a scenario file would have it."""
        return int(self._ask(do="add", fault={"kind": kind, **fields})["number"])

    def drop(self, **which: Any) -> int:
        """Replies are not there; ``on="instruction"``: no servo hears what the host says."""
        return self.add("drop", **which)

    def delay(self, **which: Any) -> int:
        """Servos answer ``delay_s`` late."""
        return self.add("delay", **which)

    def corrupt(self, **which: Any) -> int:
        """``bits`` of a packet are flipped."""
        return self.add("corrupt", **which)

    def truncate(self, **which: Any) -> int:
        """A packet breaks off after ``bytes``, or somewhere."""
        return self.add("truncate", **which)

    def split(self, **which: Any) -> int:
        """A reply has a pause of ``gap_s`` in it."""
        return self.add("split", **which)

    def duplicate(self, **which: Any) -> int:
        """A reply comes twice."""
        return self.add("duplicate", **which)

    def noise(self, **which: Any) -> int:
        """Random ``bytes`` come before a packet."""
        return self.add("noise", **which)

    def latency(self, **which: Any) -> int:
        """Adapter and host hand a reply up ``delay_s`` late."""
        return self.add("latency", **which)

    def duplicate_id(self, **which: Any) -> int:
        """``servo`` has the ``id`` of another one, too."""
        return self.add("duplicate_id", **which)

    def dead(self, **which: Any) -> int:
        """Servos have no power."""
        return self.add("dead", **which)

    def brown_out(self, **which: Any) -> int:
        """The supply fails for ``for_s``; servos start up again."""
        return self.add("brown_out", **which)

    def overload(self, **which: Any) -> int:
        """Servos raise their overload alarm."""
        return self.add("overload", **which)

    def overheat(self, **which: Any) -> int:
        """Servos are at ``temperature_c``, or above their limit."""
        return self.add("overheat", **which)

    def encoder_stuck(self, **which: Any) -> int:
        """Servos no longer see their shaft move."""
        return self.add("encoder_stuck", **which)

    def unplug(self, **when: Any) -> int:
        """The port is gone, until :meth:`replug` or for ``for_s``."""
        return self.add("unplug", **when)

    def replug(self) -> None:
        """The port is there again, for programs that open it anew."""
        self.clear("unplug")

    def clear(self, which: int | str | None = None) -> int:
        """End faults: by number, by kind, or all; how many there were."""
        return int(self._ask(do="clear", which=which)["ended"])

    def seed(self, seed: int) -> None:
        """Start the random numbers of the faults to come from here. At first it is 0."""
        self._ask(do="seed", seed=seed)

    def scenario(self, path: str | Path) -> list[int]:
        """Have the faults of a file, with its seed; their numbers."""
        return list(self._ask(do="scenario", path=str(path))["numbers"])

    def standing(self) -> list[Standing]:
        """How the faults stand, in the order of their numbers."""
        return [Standing(**each) for each in self._ask(do="list")["faults"]]

    def struck(self, number: int) -> int:
        """How often a fault has struck; ``KeyError`` if there is none of that number."""
        return {each.number: each.struck for each in self.standing()}[number]
