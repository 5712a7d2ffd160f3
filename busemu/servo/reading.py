"""What a read has to look at: only what it may bring, however much the drive fills."""

from __future__ import annotations

from collections.abc import Callable

from ..plant import ServoState
from .indirect import Indirect
from .memory import MOST_PLACES, Memory
from .registers import Behaviour

#: Fills registers from the state of the drive and the instant [s].
View = Callable[[ServoState, float], None]


class Reading:
    """The reads of one servo: by address and length, what fills the registers they bring."""

    def __init__(self, memory: Memory, indirect: Indirect, behaviour: Behaviour) -> None:
        self._memory = memory
        self._indirect = indirect
        self._behaviour = behaviour
        self._views: dict[tuple[int, int], View] = {}

    def view(self, address: int, length: int) -> View | None:
        """What is to be called before a read; ``None`` where not all of the addresses exist."""
        view = self._views.get((address, length))
        if view is None and self._memory.covers(address, length):
            if len(self._views) >= MOST_PLACES:
                self._views.clear()
            view = self._views[address, length] = self._view(address, length)
        return view

    def _view(self, address: int, length: int) -> View:
        behaviour = self._behaviour
        names = {register.name for register in self._memory.registers(address, length)}
        wanted = names & behaviour.shown
        if not wanted <= behaviour.quick.keys() or self._indirect.within(address, length):
            return behaviour.show
        sensors = [behaviour.quick[name] for name in wanted]
        if len(sensors) == 1:
            (sensor,) = sensors
            return lambda state, now_s: sensor(state)

        def show(state: ServoState, now_s: float) -> None:
            for sensor in sensors:
                sensor(state)

        return show
