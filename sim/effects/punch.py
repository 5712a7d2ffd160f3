"""A least duty beyond the dead zone that the registers do not tell."""

from __future__ import annotations

from dataclasses import replace

from .effect import Effect, Group, Parameter, Scope, on_drives

EFFECT = Effect(
    name="punch",
    group=Group.CONTROLLER,
    scope=Scope.JOINT,
    enters="controller",
    equation="duty = sign(error) (punch + gain (|error| - margin))",
    source="punch, ROBOTIS e-manual",
    parameters=(
        Parameter(
            "duty",
            "(ratio)",
            0.0,
            0.5,
            typical=0.031,
            off=0.0,
            source="32 of 1023, ROBOTIS e-manual",
        ),
    ),
    note=(
        "It adds to what the register `punch` holds. Of AX servos the manual draws that this is "
        "added to the duty, and public logs show it of an STS3215; of other servos with PID gains "
        "that have the register (XL-320, MX with Protocol 1.0) nobody documents it, and the "
        "emulator adds it: `punch_left_out` takes it away. A diagnosis fits that share as a "
        "tolerance of all servos with PID gains, so that on them a dead zone as small as the "
        "register's punch is no finding."
    ),
    change=on_drives(lambda d, v: replace(d, punch_more=d.punch_more + v["duty"])),
)
