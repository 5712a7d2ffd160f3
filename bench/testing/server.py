"""``python -m bench.testing.server ROBOT PLANT TIMING [LINK]``: a served bus that tells the truth.

It serves as ``busemu serve`` does, and between two packets answers questions that come in on its
standard input, one JSON object a line. It ends when its input does.
"""

from __future__ import annotations

import json
import os
import select
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from busemu.assemble import assemble, plants
from busemu.chance import seeded
from busemu.faults import Faults
from busemu.ports.port import plug_of
from busemu.ports.pty import LinkError, PtyPort
from busemu.serve import Station, prepare_process, serve
from busemu.tables import RobotError, TableError, load_robot
from busemu.timing import ProfileError, load_profile

from .truth import Truth

#: How often the server looks for questions [s].
LOOK_EVERY_S = 0.002


class Questions:
    """Answers what has come in on a descriptor; ``SystemExit`` when that has ended."""

    def __init__(self, truth: Truth, path: Callable[[], str], descriptor: int) -> None:
        self._questions = {**truth.questions, "path": lambda: {"path": path()}}
        self._descriptor = descriptor
        self._heard = b""

    def __call__(self, now_s: float) -> None:
        """Look for questions, without waiting for any."""
        if not select.select([self._descriptor], [], [], 0.0)[0]:
            return
        data = os.read(self._descriptor, 65536)
        if not data:
            raise SystemExit(0)
        *lines, self._heard = (self._heard + data).split(b"\n")
        for line in lines:
            asked = json.loads(line)
            _say(self._questions[asked.pop("question")](**asked))


def _say(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)


def main(robot: str, plant: str, timing: str, link: str | None = None) -> None:
    """Serve until the input ends. A mistake of the user's is one line and exit code 1."""
    try:
        described = load_robot(robot)
        profile = load_profile(timing)
        makers = plants()
        if plant not in makers:
            sys.exit(f"no plant named {plant!r}: use one of {', '.join(makers)}")
        port = PtyPort(Path(link) if link else None)
    except (RobotError, TableError, ProfileError, LinkError) as error:
        sys.exit(str(error))
    try:
        joints = makers[plant](described)
        prepare_process()
        bus = assemble(described, joints, profile, start_s=time.monotonic())
        _say({"path": port.path})
        faults = Faults(bus, described, seeded(0), plug_of(port))
        truth = Truth(described, bus, faults)
        questions = Questions(truth, lambda: port.path, sys.stdin.fileno())
        serve(Station(port, bus, LOOK_EVERY_S, questions))
    finally:
        port.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
