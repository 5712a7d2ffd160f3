"""Pictures from rendered frames: a strip of stills, and an animated GIF.

Frames are arrays of shape (height, width, 3), uint8, red-green-blue, row 0 on top; all of one size.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..files import replacing

Frame = NDArray[np.uint8]

GUTTER_PX = 4
LABEL_PX = 18
BACKGROUND = (255, 255, 255)
TEXT = (34, 39, 46)
#: a GIF's palette is chosen from at most so many frames, and about so many of their pixels
PALETTE_FRAMES = 32
PALETTE_PX = 500_000


def film_strip(
    frames: Sequence[Frame], t_s: Sequence[float], *, count: int = 6, columns: int | None = None
) -> Image.Image:
    """Lay ``count`` frames, evenly spread over ``frames``, side by side, with their times below.

    ``t_s``: the frames' times [s]. ``columns``: frames in a row, all by default. Raises
    ``ValueError`` for no frames, frames of different sizes, or another number of times.
    """
    _check(frames)
    if len(t_s) != len(frames):
        raise ValueError(f"{len(frames)} frames, but {len(t_s)} times")
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(count, len(frames))).round().astype(int))
    columns = min(columns or len(chosen), len(chosen))
    rows = -(-len(chosen) // columns)
    height, width = frames[0].shape[:2]
    cell = (width + GUTTER_PX, height + LABEL_PX + GUTTER_PX)
    strip = Image.new(
        "RGB", (columns * cell[0] - GUTTER_PX, rows * cell[1] - GUTTER_PX), BACKGROUND
    )
    draw = ImageDraw.Draw(strip)
    font = ImageFont.load_default(size=LABEL_PX - 5)
    for place, index in enumerate(chosen.tolist()):
        left, top = place % columns * cell[0], place // columns * cell[1]
        strip.paste(Image.fromarray(np.ascontiguousarray(frames[index])), (left, top))
        middle = (left + width // 2, top + height + LABEL_PX // 2)
        draw.text(middle, f"{t_s[index]:.2f} s", fill=TEXT, font=font, anchor="mm")
    return strip


def write_gif(frames: Sequence[Frame], path: str | Path, *, frame_s: float) -> Path:
    """Write an endless GIF that shows every frame for ``frame_s`` [s]; returns the path.

    GIF counts in hundredths of a second: the rounding is carried from frame to frame, so that the
    whole keeps its length. Raises ``ValueError`` for no frames, frames of different sizes, or a
    ``frame_s`` under 0.02 (players slow such files down).
    """
    _check(frames)
    if frame_s < 0.02:
        raise ValueError(f"frame_s must be at least 0.02, not {frame_s:g}: leave frames out")
    ticks = np.diff(np.round(np.arange(len(frames) + 1) * frame_s * 100.0)).astype(int)
    palette = _palette(frames)
    images = [
        Image.fromarray(np.ascontiguousarray(frame)).quantize(
            palette=palette, dither=Image.Dither.NONE
        )
        for frame in frames
    ]
    path = Path(path)
    with replacing(path) as file:
        images[0].save(
            file,
            format="GIF",
            save_all=True,
            append_images=images[1:],
            duration=(ticks * 10).tolist(),
            loop=0,
            optimize=False,
        )
    return path


def _palette(frames: Sequence[Frame]) -> Image.Image:
    """Choose one palette for all frames, so that colours do not flicker."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, PALETTE_FRAMES).astype(int))
    some = np.concatenate([frames[i] for i in chosen])
    step = max(1, int(np.sqrt(some.shape[0] * some.shape[1] / PALETTE_PX)))
    thinned = np.ascontiguousarray(some[::step, ::step])
    return Image.fromarray(thinned).quantize(256, method=Image.Quantize.MEDIANCUT)


def _check(frames: Sequence[Frame]) -> None:
    if not frames:
        raise ValueError("no frames")
    for number, frame in enumerate(frames):
        if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3:
            raise ValueError(f"frame {number} is no (height, width, 3) array of uint8")
        if frame.shape != frames[0].shape:
            raise ValueError(f"frame {number} is {frame.shape}, the first is {frames[0].shape}")
