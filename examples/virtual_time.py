"""The official SDK on an emulated bus in this process: no port, no waiting, the same every time."""

from dynamixel_sdk import PacketHandler

from busemu.assemble import assemble
from busemu.clock import VirtualClock
from busemu.plant import ideal
from busemu.ports.sdk import SdkPort
from busemu.tables import load_robot
from busemu.timing import load_profile

PRESENT_POSITION, GOAL_POSITION, TORQUE_ENABLE = 37, 30, 24  # XL-320

robot = load_robot("marvin")
clock = VirtualClock()
port = SdkPort(assemble(robot, ideal(robot), load_profile(robot.timing)), clock)
packets = PacketHandler(2.0)

packets.write1ByteTxRx(port, 1, TORQUE_ENABLE, 1)
packets.write2ByteTxRx(port, 1, GOAL_POSITION, 600)
for _ in range(10):
    position, _, _ = packets.read2ByteTxRx(port, 1, PRESENT_POSITION)
    print(f"{clock.now_s() * 1e3:6.2f} ms: position {position}")
    clock.sleep_until(clock.now_s() + 0.020)
