"""What a robot's program meets on a bad bus, in virtual time and the same every time."""

from pathlib import Path

from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, PacketHandler

from busemu.assemble import assemble
from busemu.chance import seeded
from busemu.clock import VirtualClock
from busemu.faults import Faults, load_scenario
from busemu.plant import ideal
from busemu.ports.sdk import SdkPort
from busemu.tables import load_robot
from busemu.timing import load_profile

robot = load_robot("marvin")
clock = VirtualClock()
bus = assemble(robot, ideal(robot), load_profile(robot.timing))
port = SdkPort(bus, clock)
packets = PacketHandler(2.0)

scenario = load_scenario(Path(__file__).with_name("faults.toml"), robot)
faults = Faults(bus, robot, seeded(scenario.seed))
for fault in scenario.faults:
    faults.add(fault)

reads = GroupSyncRead(port, packets, 37, 2)  # present_position of an XL-320
for servo in robot.servos:
    reads.addParam(servo.servo_id)
for _ in range(100):
    result = reads.txRxPacket()
    if result != COMM_SUCCESS:
        print(f"{clock.now_s():.3f} s: {packets.getTxRxResult(result)}")
    clock.sleep_until(clock.now_s() + 0.020)
for fault in faults.standing():
    print(f"{fault.struck:3} times: {fault.words}")
