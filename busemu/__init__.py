"""busemu: a Dynamixel servo bus without the servos.

Bytes come in at a port (:mod:`busemu.ports`), become instructions on a bus (:mod:`busemu.bus`) and
change a servo's registers (:mod:`busemu.servo`); a plant (:mod:`busemu.plant`) moves the joint.
"""
