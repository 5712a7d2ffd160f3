"""Which registers a run of bytes in a servo's memory is.

Bytes that are no whole register of the servo's control table, or of a servo that nobody has
described, are kept one by one under the namespace ``wire``, where a recording keeps what its
control tables do not have: ``wire/servo_7/byte_90``, a number from 0 to 255.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from busemu.tables import ControlTable

#: A row's servo ID (0 under the namespace) and register; its first byte in the run, and its length.
Field = tuple[int, str, int, int]


class WireRegisters:
    """Cuts runs of bytes into registers. ``tables`` are control tables by servo ID."""

    def __init__(self, tables: Mapping[int, ControlTable]) -> None:
        self._by_address = {
            servo_id: {register.address: register for register in table.registers}
            for servo_id, table in tables.items()
        }
        self._known: dict[tuple[int, int, int], tuple[Field, ...]] = {}

    def __call__(self, servo_id: int, address: int, length: int) -> tuple[Field, ...]:
        """The registers of ``length`` bytes from ``address`` on, in the order of addresses."""
        key = (servo_id, address, length)
        fields = self._known.get(key)
        if fields is None:
            fields = self._known[key] = tuple(self._cut(*key))
        return fields

    def _cut(self, servo_id: int, address: int, length: int) -> Iterator[Field]:
        by_address = self._by_address.get(servo_id, {})
        at = 0
        while at < length:
            register = by_address.get(address + at)
            if register is not None and at + register.size <= length:
                yield servo_id, register.name, at, register.size
                at += register.size
            else:
                yield 0, f"wire/servo_{servo_id}/byte_{address + at}", at, 1
                at += 1
