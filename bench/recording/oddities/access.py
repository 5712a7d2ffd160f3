"""Oddities of accesses: lost replies, registers that are not written, servos nobody knows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from busemu.wording import amount

from ..columns import numbers
from ..recording import Recording
from ..rules import READ, WRITE
from .channel import Channel, at
from .oddity import Oddity, Weight, first_rows


def check(channel: Channel) -> Iterator[Oddity]:
    """Lost replies, values out of range and writes to read-only registers of one series."""
    if "/" in channel.name:
        return
    lost = np.flatnonzero(np.isnan(channel.raw))
    if channel.op == READ and lost.size:
        ends = np.flatnonzero(np.diff(lost) > 1)
        runs = np.diff(np.concatenate([[-1], ends, [lost.size - 1]]))
        share = lost.size / len(channel.raw)
        yield at(
            channel,
            lost,
            "lost_replies",
            Weight.WARNING if share > 0.01 and lost.size > 1 else Weight.NOTE,
            f"{lost.size} of {len(channel.raw)} reads without an answer ({share:.2%}), "
            f"at most {runs.max()} in a row",
            "what moved meanwhile is not known; losses at high load hint at the cable or supply",
            "leave these samples out; do not fill them in",
        )
    register = channel.register
    if register is None:
        return
    if channel.op == WRITE and not register.writable:
        yield at(
            channel,
            np.arange(len(channel.raw)),
            "read_only_written",
            Weight.WARNING,
            f"{len(channel.raw)} writes to a register that only the servo changes",
            "the servo refuses them: model or register name may be wrong",
            "check [servo.N] model",
        )
    counts = channel.counts()
    limits = (register.minimum, register.maximum)
    turn = None if channel.model is None else channel.model.drive.get("turn_counts")
    if turn and channel.op == READ and channel.name == "present_position":
        limits = (limits[0], int(turn) - 1) if np.nanmax(counts, initial=0.0) <= turn else limits
    outside = np.flatnonzero((counts < limits[0]) | (counts > limits[1]))
    if outside.size:
        yield at(
            channel,
            outside,
            "out_of_range",
            Weight.WARNING,
            f"{amount(outside.size, 'value')} outside {limits[0]} to {limits[1]}, such as "
            f"{counts[outside[0]]:.0f}",
            "a servo of this model does not send them: bad reads, or another model",
            "leave these samples out, or name the servo's true model",
        )


def check_servos(recording: Recording) -> Iterator[Oddity]:
    """Servos of unknown model or on no robot, and replies before their instruction."""
    for servo_id in recording.servo_ids:
        if servo_id not in recording.models:
            yield Oddity(
                "unknown_model",
                Weight.WARNING,
                "the servo's model is not known",
                "its registers cannot be checked or read in SI",
                f'say [servo.{servo_id}] model = "...", or name the robot',
                servo_id,
            )
        elif recording.robot is not None and servo_id not in recording.robot.by_id:
            yield Oddity(
                "not_on_robot",
                Weight.WARNING,
                f"robot {recording.robot.name} has no servo of this ID",
                "it belongs to no joint, so it takes no part in any comparison",
                "name the right robot, or correct the ID",
                servo_id,
            )
    early = np.flatnonzero(numbers(recording.table, "t_reply_s") < recording.t_s)
    if early.size:
        yield Oddity(
            "reply_before_instruction",
            Weight.WARNING,
            f"{early.size} replies dated before their instruction",
            "two clocks were mixed, or the columns are exchanged: delays will come out wrong",
            "date both with one monotonic clock",
            t_start_s=float(recording.t_s[early[0]]),
            rows=first_rows(early),
            count=early.size,
        )
