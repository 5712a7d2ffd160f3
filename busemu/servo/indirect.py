"""Indirect addresses: bytes of the indirect data that stand for bytes elsewhere.

``indirect_address_3`` holds the address that the byte ``indirect_data_3`` stands for. From the
factory each names its own data byte, which is then a byte of memory like any other. Reads and
writes go through, with the access and range of the register they reach (e-manual, "Indirect
Address, Indirect Data"). One step only: a chain of indirect bytes is not followed (assumed).
"""

from __future__ import annotations

from .memory import Memory

#: Address and bytes of a write that go to consecutive places.
Run = tuple[int, bytes]


class Indirect:
    """The indirect data of one servo; empty for a model that has none."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._holder: dict[int, str] = {}  #: address of an indirect data byte -> who names its goal
        for register in memory.table.registers:
            holder = register.name.replace("indirect_data_", "indirect_address_")
            if holder != register.name and memory.has(holder):
                self._holder[register.address] = holder

    def target(self, address: int) -> int:
        """The address that ``address`` stands for: itself, unless it is indirect data."""
        holder = self._holder.get(address)
        if holder is None:
            return address
        return self._memory[holder]

    def within(self, address: int, length: int) -> bool:
        """Whether any of the addresses may stand for others."""
        return not self._holder.keys().isdisjoint(range(address, address + length))

    def read(self, address: int, length: int) -> bytes:
        """The bytes that a read of existing addresses brings."""
        read = self._memory.read(address, length)
        if not self.within(address, length):
            return read
        data = bytearray(read)
        for offset in range(length):
            target = self.target(address + offset)
            if target != address + offset:
                data[offset] = self._memory.read(target, 1)[0]
        return bytes(data)

    def runs(self, address: int, data: bytes) -> list[Run]:
        """Where the bytes of a write go, consecutive ones together, in the order of the packet."""
        if not self._holder:
            return [(address, data)]
        runs: list[tuple[int, bytearray]] = []
        for offset, value in enumerate(data):
            target = self.target(address + offset)
            if runs and runs[-1][0] + len(runs[-1][1]) == target:
                runs[-1][1].append(value)
            else:
                runs.append((target, bytearray([value])))
        return [(start, bytes(part)) for start, part in runs]
