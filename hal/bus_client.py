"""The host's side of the bus: registers by name, through the unmodified packet handlers of the SDK.

Four habits of dynamixel-sdk 4.1.0 are dealt with here.

* ``Protocol2PacketHandler.txPacket`` drops the result of ``addStuffing``: a write whose bytes hold
  ``FF FF FD`` would go out unstuffed, and a servo may take it for a new header. Such a write is
  refused with :class:`UnsendableError`. It takes a register of three bytes or more: within a
  sync_write an ID (252 at most) stands between two servos' data, so two-byte positions never do it.
* ``GroupSyncRead`` drops the error field of each status packet, and all values once one servo is
  mute. A sync_read here makes the same calls (``syncReadTx``, then ``readRx`` for each servo)
  and keeps the alerts, the values that did come, and the instant of each.
* A status packet without parameters leaves its checksum where the value should be. The bytes that
  came in are counted, and such a reply is reported as corrupt.
* A transaction cut off by an exception (Ctrl-C, an unplugged adapter) leaves the port marked as in
  use, and nothing could be sent any more, not even "torque off". The mark is taken back.
"""

from __future__ import annotations

import errno
import math
import termios
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import dynamixel_sdk as sdk

from busemu.tables import ControlTable, Register

from .access import Access, BusStatistics, Failure
from .bus_errors import (
    ANGLE_LIMIT,
    HARDWARE_ALERT,
    REFUSAL_BITS,
    CorruptReplyError,
    NoReplyError,
    PortError,
    PortLostError,
    ReplyError,
    ServoError,
    UnsendableError,
)
from .clock import Clock
from .port import Port, StampedPort

#: Bytes of a status packet around its parameters; source: e-manual, Protocol 1.0 and 2.0.
STATUS_OVERHEAD = {1.0: 6, 2.0: 11}
#: What Protocol 2.0 must stuff; source: e-manual, Protocol 2.0, byte stuffing.
NEEDS_STUFFING = b"\xff\xff\xfd"
NOT_SENT = {
    sdk.COMM_TX_ERROR: "the instruction packet would be too long: address fewer servos at once",
    sdk.COMM_TX_FAIL: "the port took only part of the instruction packet",
    sdk.COMM_PORT_BUSY: "the port is in use by another client",
    sdk.COMM_NOT_AVAILABLE: "the protocol has no such instruction for this ID",
}


def open_port(path: str, baud_rate: int) -> Port:
    """Open the SDK's own port on a serial device; :class:`PortError` says what to do."""
    port = sdk.PortHandler(path)
    try:
        supported = port.setBaudRate(baud_rate)
    except (OSError, termios.error, ValueError) as error:
        raise PortError(_why_not_open(path, baud_rate, error)) from None
    if not supported:
        raise PortError(
            f"{path}: dynamixel-sdk does not offer {baud_rate} baud: use one of its rates, "
            "such as 57600, 115200 or 1000000"
        )
    opened: Port = port
    return opened


def _why_not_open(path: str, baud_rate: int, error: Exception) -> str:
    code = getattr(error, "errno", None)
    cause = error.__context__ or error  # pyserial hides the number of a failed ioctl behind its own
    if code is None and isinstance(cause, termios.error) and cause.args:
        code = cause.args[0]
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return (
            f"{path}: no such port: plug the adapter in, or look in /dev/serial/by-id for its name"
        )
    if code in (errno.EACCES, errno.EPERM):
        return f"{path}: permission denied: join the group that owns the port (often dialout)"
    if code in (errno.EBUSY, errno.EAGAIN):
        return f"{path}: busy: another program holds the port; close that program"
    if code in (errno.ENOTTY, errno.EISDIR):
        return f"{path}: not a serial port: give the device of the adapter"
    if isinstance(error, ValueError):
        return f"{path}: the adapter does not offer {baud_rate} baud: use another rate"
    return f"{path}: cannot be opened: {error}"


class BusClient:
    """Registers of servos by name, over one port.

    ``port`` is anything with the interface of the SDK's ``PortHandler``. ``robot_tables`` gives the
    control table of each servo ID. ``on_access`` is told of every register access, in order.
    Values are raw: unsigned, as on the wire. An alert in a status packet is not a failure: the
    value is kept and the alert counted in :attr:`statistics`.
    """

    def __init__(
        self,
        port: Port,
        robot_tables: Mapping[int, ControlTable],
        protocol: float,
        clock: Clock,
        on_access: Callable[[Access], None] | None = None,
    ) -> None:
        if protocol not in STATUS_OVERHEAD:
            raise ValueError(f"protocol must be 1.0 or 2.0, not {protocol}")
        self.protocol = protocol
        self.statistics = BusStatistics()
        self.on_access = on_access
        self._tables = robot_tables
        self._port = StampedPort(port, clock)
        self._handler: Any = (
            sdk.Protocol1PacketHandler() if protocol == 1.0 else sdk.Protocol2PacketHandler()
        )
        self._sync_writes: dict[tuple[int, int], Any] = {}
        self._layouts: dict[tuple[str, tuple[int, ...]], dict[tuple[int, int], list[int]]] = {}

    def ping(self, servo_id: int) -> int:
        """Ask a servo for its model number; raises as :meth:`read` does."""
        self.statistics.transactions += 1
        reply = self._call(self._handler.ping, self._port, servo_id)
        model, result, error = reply or (0, sdk.COMM_RX_CORRUPT, 0)
        self._judge(servo_id, "ping", result, error, writing=False)
        return int(model)

    def read(self, servo_id: int, register: str) -> int:
        """Read a register's raw value. Raises :class:`ReplyError` or :class:`PortLostError`."""
        place = self._tables[servo_id][register]
        sent = self._port.sent
        raw: int | None = None
        self.statistics.transactions += 1
        try:
            raw = self._receive(
                self._handler.readTxRx, servo_id, register, place.size, place.address
            )
        finally:
            if self._port.sent != sent:
                self._log_read(servo_id, register, raw)
        return raw

    def write(self, servo_id: int, register: str, raw: int) -> None:
        """Set a register and await the status packet.

        Raises :class:`ReplyError`, :class:`PortLostError`, :class:`UnsendableError`, or
        ``ValueError`` if ``raw`` does not fit in the register's bytes.
        """
        place = self._tables[servo_id][register]
        data = self._bytes(servo_id, place, raw)
        sent = self._port.sent
        self.statistics.transactions += 1
        try:
            reply = self._call(
                self._handler.writeTxRx, self._port, servo_id, place.address, place.size, data
            )
        finally:
            if self._port.sent != sent:
                self._log_write(servo_id, register, raw)
        result, error = reply or (sdk.COMM_RX_CORRUPT, 0)
        self._judge(servo_id, f"write of {register}", result, error, writing=True)

    def sync_write(self, register: str, values: Mapping[int, int]) -> None:
        """Set one register of many servos with one packet, which no servo answers.

        Where the servos' tables place the register differently, one packet goes to each kind.
        Raises :class:`PortLostError`, :class:`UnsendableError` or ``ValueError``.
        """
        for layout, ids in self._by_layout(register, tuple(values)).items():
            group = self._sync_writes.get(layout)
            if group is None:
                group = sdk.GroupSyncWrite(self._port, self._handler, *layout)
                self._sync_writes[layout] = group
            group.clearParam()
            for servo_id in ids:
                place = self._tables[servo_id][register]
                group.addParam(servo_id, self._bytes(servo_id, place, values[servo_id]))
            self.statistics.transactions += 1
            result = self._call(group.txPacket)
            if result != sdk.COMM_SUCCESS:
                raise _not_sent(f"sync_write of {register}", result)
            for servo_id in ids:
                self._log_write(servo_id, register, values[servo_id])

    def read_all(self, register: str, ids: Iterable[int]) -> dict[int, int | None]:
        """One register of many servos: raw values by ID, ``None`` where no good answer came.

        One sync_read on Protocol 2.0; one read after the other on Protocol 1.0, which has none.
        Lost replies are counted; only :class:`PortLostError` and :class:`UnsendableError` raise.
        """
        values: dict[int, int | None] = dict.fromkeys(ids)
        if self.protocol == 2.0:
            for (address, size), group in self._by_layout(register, tuple(values)).items():
                self._sync_read(register, address, size, group, values)
            return values
        for servo_id in values:
            try:
                values[servo_id] = self.read(servo_id, register)
            except ReplyError:
                values[servo_id] = None
        return values

    def _sync_read(
        self, register: str, address: int, size: int, ids: list[int], values: dict[int, int | None]
    ) -> None:
        self.statistics.transactions += 1
        result = self._call(
            self._handler.syncReadTx, self._port, address, size, ids, len(ids), False
        )
        if result != sdk.COMM_SUCCESS:
            raise _not_sent(f"sync_read of {register}", result)
        answers = iter(ids)
        for servo_id in answers:
            try:
                values[servo_id] = self._receive(self._handler.readRx, servo_id, register, size)
            except NoReplyError:  # a mute servo silences all after it: they wait for its reply
                self._port.is_using = False
                self._log_read(servo_id, register, None)
                break
            except ReplyError:
                values[servo_id] = None
            self._log_read(servo_id, register, values[servo_id])
        for servo_id in answers:
            self.statistics.failures[Failure.NO_REPLY] += 1
            self._log_read(servo_id, register, None)

    def _receive(
        self, call: Callable[..., Any], servo_id: int, register: str, size: int, *address: int
    ) -> int:
        """Take the value from the status packet that an SDK read call returns."""
        port = self._port
        received = port.received
        reply = self._call(call, port, servo_id, *address, size)
        data, result, error = reply or ((), sdk.COMM_RX_CORRUPT, 0)
        self._judge(servo_id, f"read of {register}", result, error, writing=False)
        if port.received - received < STATUS_OVERHEAD[self.protocol] + size or len(data) < size:
            self.statistics.failures[Failure.CORRUPT] += 1
            raise CorruptReplyError(servo_id, f"read of {register}: status packet too short")
        return int.from_bytes(bytes(data), "little")

    def _call(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call the SDK; ``None`` where it reads past the end of a short status packet."""
        try:
            return call(*arguments)
        except IndexError:
            self._port.is_using = False
            return None
        except (OSError, termios.error) as error:
            self._port.is_using = False
            self.statistics.failures[Failure.PORT_LOST] += 1
            raise PortLostError(f"the port failed in use (adapter unplugged?): {error}") from error
        except BaseException:
            self._port.is_using = False
            raise

    def _judge(self, servo_id: int, what: str, result: int, error: int, *, writing: bool) -> None:
        """Raise for a failed transaction; count the alert of a good one."""
        failures = self.statistics.failures
        if result == sdk.COMM_RX_TIMEOUT:
            failures[Failure.NO_REPLY] += 1
            raise NoReplyError(servo_id, f"{what}: no status packet: check power, ID and baud rate")
        if result == sdk.COMM_RX_CORRUPT:
            failures[Failure.CORRUPT] += 1
            raise CorruptReplyError(servo_id, f"{what}: damaged status packet")
        if result != sdk.COMM_SUCCESS:
            raise _not_sent(what, result)
        if not error:
            return
        if self.protocol == 1.0:
            refusal = error & (REFUSAL_BITS | (ANGLE_LIMIT if writing else 0))
        else:
            refusal = error & ~HARDWARE_ALERT
        alert = error & ~refusal
        if alert:
            self.statistics.alerts[servo_id] += 1
            bits = self.statistics.alert_bits
            bits[servo_id] = bits.get(servo_id, 0) | alert
        if refusal:
            failures[Failure.SERVO_ERROR] += 1
            raise ServoError(servo_id, what, error, self.protocol)

    def _bytes(self, servo_id: int, place: Register, raw: int) -> bytes:
        if not 0 <= raw <= place.raw_maximum:
            raise ValueError(
                f"servo {servo_id}: {place.name} {raw} does not fit in {place.size} byte(s)"
            )
        data = raw.to_bytes(place.size, "little")
        if self.protocol == 2.0 and NEEDS_STUFFING in data:
            raise UnsendableError(
                f"servo {servo_id}: {place.name} {raw} holds the bytes FF FF FD, which "
                "dynamixel-sdk sends without stuffing: write a value one step beside it"
            )
        return data

    def _by_layout(self, register: str, ids: tuple[int, ...]) -> dict[tuple[int, int], list[int]]:
        """IDs by (address, size) of the register in their tables."""
        layouts = self._layouts.get((register, ids))
        if layouts is None:
            layouts = {}
            for servo_id in ids:
                place = self._tables[servo_id][register]
                layouts.setdefault((place.address, place.size), []).append(servo_id)
            self._layouts[register, ids] = layouts
        return layouts

    def _log_read(self, servo_id: int, register: str, raw: int | None) -> None:
        if self.on_access is None:
            return
        t_s, t_reply_s = self._port.sent_s, self._port.received_s
        if raw is None:
            self.on_access(Access(t_s, math.nan, servo_id, "read", register, math.nan))
        else:
            self.on_access(Access(t_s, t_reply_s, servo_id, "read", register, float(raw)))

    def _log_write(self, servo_id: int, register: str, raw: int) -> None:
        if self.on_access is not None:
            sent_s = self._port.sent_s
            self.on_access(Access(sent_s, math.nan, servo_id, "write", register, float(raw)))


def _not_sent(what: str, result: int) -> UnsendableError:
    return UnsendableError(f"{what}: {NOT_SENT.get(result, f'the SDK refused it ({result})')}")
