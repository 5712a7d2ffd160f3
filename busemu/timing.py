"""Where each microsecond of a transaction goes.

A transaction is the sum of parts, each of which a profile names, so that turning one knob (baud
rate, return delay, latency timer) moves the result the way it does on a real bus::

    program | host | USB frame | adapter | wire -> servo: turnaround, return delay, interrupt
    program | host | USB frame | adapter: chunk full, or latency timer | wire <- status packet

The parts, in order:

* **host**: the program's own time to hand a packet to the driver and to take the reply. On a live
  port the program spends it itself; in virtual time it is charged.
* **USB frame**: the host controller serves the adapter once a frame, so a transfer waits half a
  frame on average, each way.
* **adapter**: takes one packet after the other, and needs ``adapter_out_s`` to begin sending each.
* **wire**: ``bits_per_byte`` a byte at the baud rate the client has really set.
* **turnaround**: the servo takes the packet in and looks at its registers.
* **return delay**: the servo's own register; it covers the turnaround.
* **interrupt**: the servo's motor control interrupt, which holds a reply back if it is due then.
* **chunk and latency timer**: the adapter hands bytes up when ``chunk_bytes`` are there, or when
  the timer that began with the first byte runs out; with no timer, at the end of each packet.
* **wake**: the host's kernel brings the bytes to the port the program reads.

What varies from packet to packet on a real bus (phase of the USB frame, phase of the interrupt)
enters with its mean: a profile gives typical times, without jitter.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from .tables.toml_file import read_toml

PROFILES = Path(__file__).with_name("profiles")

#: A gap between two bytes that ends a packet [s]. Source: e-manual, both protocols.
INTERBYTE_TIMEOUT_S = {1.0: 0.100, 2.0: 0.0015}


class ProfileError(ValueError):
    """A timing profile that cannot be used: says the file, the key, the rule."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Times of one host, adapter and bus; all in seconds unless the name says otherwise.

    Zero everywhere is the ideal bus: only the wire and the servos' return delay take time.
    """

    name: str
    source: str = ""
    host_out_s: float = 0.0
    host_in_s: float = 0.0
    usb_frame_s: float = 0.0
    adapter_out_s: float = 0.0
    wake_s: float = 0.0  #: from the transfer's end until the host's kernel hands the bytes over
    latency_timer_s: float = 0.0
    chunk_bytes: int = 0
    bits_per_byte: int = 10
    turnaround_s: float = 0.0
    interrupt_period_s: float = 0.0
    interrupt_busy_s: float = 0.0
    chain_lead_s: float = 0.0  #: how much sooner than its return delay a chained reply begins
    ping_slot_s: float = 0.0  #: spacing of replies to a broadcast ping, times the ID
    usb2ax_timeout_s: float = 0.0  #: of the adapter's own sync read, for a servo; 0: it has none
    eeprom_byte_s: float = 0.0  #: a servo is deaf so long for each byte of EEPROM written
    echo: bool = False  #: the adapter hears what it sends
    instant: bool = False  #: no time at all, not even on the wire

    def byte_s(self, baud_rate: int) -> float:
        """Time of one byte on the wire [s]."""
        return 0.0 if self.instant else self.bits_per_byte / baud_rate

    def out_s(self) -> float:
        """From a packet's turn at the driver until its first bit is on the wire [s]."""
        return self.usb_frame_s / 2 + self.adapter_out_s

    def in_s(self) -> float:
        """From the adapter's hand-up until the bytes lie ready for the program [s]."""
        return self.usb_frame_s / 2 + self.wake_s

    def interrupt_s(self) -> float:
        """Mean wait for the servo's control interrupt to be over [s]."""
        if self.interrupt_period_s == 0.0:
            return 0.0
        return self.interrupt_busy_s**2 / (2 * self.interrupt_period_s)

    def reply_s(self, return_delay_s: float, *, chained: bool = False) -> float:
        """From the end of the packet a servo waits for until it begins its reply [s]."""
        if self.instant:
            return 0.0
        wait_s = return_delay_s - (self.chain_lead_s if chained else 0.0)
        return max(self.turnaround_s, wait_s) + self.interrupt_s()


def profiles() -> tuple[str, ...]:
    """Names of the profiles that come with the package, sorted."""
    return tuple(sorted(path.stem for path in PROFILES.glob("*.toml")))


def load_profile(name_or_path: str | Path) -> Profile:
    """A profile by name, or by the path of a TOML file. Raises :class:`ProfileError`."""
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = PROFILES / f"{name_or_path}.toml"
        if not path.is_file():
            raise ProfileError(
                f"no timing profile named {str(name_or_path)!r}: use one of "
                f"{', '.join(profiles())}, or the path of a profile ending in .toml"
            )
    document = read_toml(path, ProfileError)
    if not document:
        raise ProfileError(f"{path}: empty: a profile says where its times are from (source = ...)")
    return _profile(document, path)


def _profile(document: dict[str, Any], path: Path) -> Profile:
    known = {f.name: f.type for f in fields(Profile)}
    base = Profile(name=path.stem)
    values: dict[str, Any] = {}
    for key, value in document.items():
        if key not in known:
            raise ProfileError(f"{path}: unknown key {key!r}; known are {', '.join(known)}")
        if key in ("name", "source"):
            values[key] = str(value)
        elif key in ("echo", "instant"):
            if not isinstance(value, bool):
                raise ProfileError(f"{path}: {key} must be true or false, not {value!r}")
            values[key] = value
        elif type(value) not in (int, float) or not 0 <= value < math.inf:
            raise ProfileError(f"{path}: {key} must be a number of at least 0, not {value!r}")
        elif key in ("chunk_bytes", "bits_per_byte"):
            if not isinstance(value, int):
                raise ProfileError(f"{path}: {key} must be a whole number, not {value!r}")
            values[key] = value
        else:
            values[key] = float(value)
    profile = replace(base, **values)
    if profile.bits_per_byte < 1:
        raise ProfileError(f"{path}: bits_per_byte must be at least 1")
    if profile.latency_timer_s > 0.0 and profile.chunk_bytes < 1:
        raise ProfileError(f"{path}: latency_timer_s needs chunk_bytes (62 for FTDI adapters)")
    if profile.interrupt_busy_s > profile.interrupt_period_s:
        raise ProfileError(f"{path}: interrupt_busy_s is longer than interrupt_period_s")
    return profile


class Uplink:
    """The adapter's way up: bytes from the wire wait for a full chunk or for the latency timer.

    The timer starts with the byte that finds the buffer empty.
    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._held = bytearray()
        self._since_s = 0.0
        self._ready: deque[tuple[float, bytes]] = deque()

    def carry(self, data: bytes, start_s: float, byte_s: float) -> None:
        """Take bytes whose first one begins on the wire at ``start_s``.

        Bytes that are on the wire before others already taken overtake them, unless there is a
        latency timer, which knows one order only.
        """
        profile = self._profile
        if profile.latency_timer_s == 0.0:
            self._hand_up(start_s + len(data) * byte_s, data)
            return
        self._expire(start_s + byte_s)
        if not self._held:
            self._since_s = start_s + byte_s
        end_s = start_s + len(data) * byte_s
        due_s = self._since_s + profile.latency_timer_s
        if end_s <= due_s and len(self._held) + len(data) < profile.chunk_bytes:
            self._held += data  # as one: neither the timer nor a full chunk comes in between
            return
        for index in range(len(data)):
            end_s = start_s + (index + 1) * byte_s
            self._expire(end_s)
            if not self._held:
                self._since_s = end_s
            self._held.append(data[index])
            if len(self._held) >= profile.chunk_bytes:
                self._hand_up(end_s, bytes(self._held))
                self._held.clear()

    def _expire(self, now_s: float) -> None:
        due_s = self._since_s + self._profile.latency_timer_s
        if self._held and due_s < now_s:
            self._hand_up(due_s, bytes(self._held))
            self._held.clear()

    def _hand_up(self, at_s: float, data: bytes) -> None:
        ready_s = at_s + self._profile.in_s()
        index = len(self._ready)
        while index and self._ready[index - 1][0] > ready_s:
            index -= 1
        self._ready.insert(index, (ready_s, data))

    def next_deadline_s(self) -> float | None:
        """When the host has the next bytes, as far as that is known now [s]."""
        if self._ready:
            return self._ready[0][0]
        if self._held:
            return self._since_s + self._profile.latency_timer_s + self._profile.in_s()
        return None

    def poll(self, now_s: float) -> bytes:
        """The bytes that the host has by ``now_s``."""
        if self._held:
            due_s = self._since_s + self._profile.latency_timer_s
            if due_s + self._profile.in_s() <= now_s:
                self._hand_up(due_s, bytes(self._held))
                self._held.clear()
        if not self._ready or self._ready[0][0] > now_s:
            return b""
        out = bytearray()
        while self._ready and self._ready[0][0] <= now_s:
            out += self._ready.popleft()[1]
        return bytes(out)
