"""Read a servo through the official SDK: an emulated bus and a real one look the same.

First ``busemu serve --robot marvin --link /tmp/marvin``, then, in another shell,
``python examples/any_client.py /tmp/marvin``.
"""

import sys
import time

from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler

PRESENT_POSITION = 37  # XL-320

port, packets = PortHandler(sys.argv[1]), PacketHandler(2.0)
port.setBaudRate(1_000_000)  # another baud rate meets silence, as on a real bus
for servo_id in range(1, 19):
    for _ in range(3):  # a reply may be late or lost, on a real bus as well
        start = time.perf_counter()
        position, result, error = packets.read2ByteTxRx(port, servo_id, PRESENT_POSITION)
        took_ms = (time.perf_counter() - start) * 1e3
        if result == COMM_SUCCESS:
            break
    else:
        sys.exit(f"servo {servo_id}: {packets.getTxRxResult(result)}")
    print(f"servo {servo_id:2}: position {position:4}, {took_ms:.2f} ms")
port.closePort()
