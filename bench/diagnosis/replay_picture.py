"""What replays look like: angles of a recording, of its goals and of models, and what is left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from bench.figures.recording import thinned
from bench.figures.style import GOAL, INK, MEASURED, MODELLED, START, STOP, panels, styled

from .replaying import Misfit, Replayed

MOST_JOINTS = 4  #: in one picture: those that are missed by most
COLOURS = (MODELLED, MEASURED, START, STOP)  #: of models, in their order; then from the first again


@styled
def replay_picture(some: Sequence[Replayed], models: Sequence[str]) -> Figure:
    """Draw one recording, two panels a joint: the motion, and recorded less modelled, in degrees.

    ``some`` are its joints, ``models`` what the robot files are called.
    """
    worst = sorted(some, key=lambda one: -_rms(one))[:MOST_JOINTS]
    shown = [one for one in some if one in worst]
    title = some[0].recording
    if len(shown) < len(some):
        title += f" (of {len(some)} joints the {len(shown)} missed by most)"
    figure, every = panels(2 * len(shown), 9.0, 1.0 + 3.6 * len(shown), title, share_x=True)
    for one, motion, misfit in zip(shown, every[::2], every[1::2], strict=True):
        motion.set_title(one.joint)
        motion.set_ylabel("angle [°]")
        misfit.set_ylabel("misfit [°]")
        lines = [("goal", one.goal_rad, GOAL, 0.9), ("recorded", one.measured_rad, INK, 1.8)]
        colours = [COLOURS[k % len(COLOURS)] for k in range(len(models))]
        lines += [
            (name, angle, colour, 1.1)
            for name, angle, colour in zip(models, one.modelled_rad, colours, strict=True)
        ]
        for name, angle, colour, width in lines:
            if not np.isnan(angle).all():
                line = thinned(one.t_s, np.degrees(angle))
                motion.plot(*line, color=colour, lw=width, label=name)
        for left, colour in zip(one.left_rad, colours, strict=True):
            misfit.plot(*thinned(one.t_s, np.degrees(left)), color=colour, lw=1.0)
        misfit.axhline(0.0, color=INK, lw=0.8)
    every[-1].set_xlabel("time [s]")
    every[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.2)
    return figure


def _rms(one: Replayed) -> float:
    return max(Misfit.of([one], k).rms for k in range(len(one.modelled_rad)))
