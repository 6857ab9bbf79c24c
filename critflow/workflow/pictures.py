"""Figures as files small enough to keep: PNG of few colours, vector formats as they are, animations as looping GIF."""

from __future__ import annotations

import io
from collections.abc import Iterable

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

# Time for which each frame is shown, and the last one, in milliseconds.
FRAME, LAST_FRAME = 140, 2500
# Differences of a colour that are seen, and the part of a picture that may have them.
SEEN, SEEN_PART = 6, 0.03
# Few colours keep files small, and thin lines need no more.
N_COLOURS = 48


def picture(figure: Figure, format: str) -> bytes:
    """A figure as a file; PNG has at most 256 colours where that is all it needs, in a third of the bytes."""
    made = io.BytesIO()
    if format != "png":
        figure.savefig(made, format=format)
        return made.getvalue()
    figure.savefig(made, format="png")
    every = Image.open(made).convert("RGB")
    few = every.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    error = np.abs(np.asarray(every).astype(int) - np.asarray(few.convert("RGB"))).max(axis=2)
    # Shaded surfaces would show steps.
    kept = few if np.mean(error > SEEN) < SEEN_PART else every
    # Without the name of the software the same data give the same bytes.
    smaller = io.BytesIO()
    kept.save(smaller, "png", optimize=True, dpi=(figure.dpi,) * 2)
    return smaller.getvalue()


def gif(figures: Iterable[Figure]) -> bytes:
    """The figures, all of one size, as an animated GIF in one palette; each is closed once it is drawn."""
    frames = []
    for figure in figures:
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
        plt.close(figure)
    if not frames:
        raise ValueError("an animation needs at least one frame")
    # One palette for all, so that nothing flickers: that of a few frames side by side.
    chosen = frames[:: max(1, len(frames) // 4)]
    together = Image.new("RGB", (chosen[0].width * len(chosen), chosen[0].height))
    for number, frame in enumerate(chosen):
        together.paste(frame, (number * frame.width, 0))
    palette = together.quantize(N_COLOURS, dither=Image.Dither.NONE)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    moving = io.BytesIO()
    durations = [FRAME] * (len(small) - 1) + [LAST_FRAME]
    small[0].save(moving, "GIF", save_all=True, append_images=small[1:], duration=durations, loop=0, optimize=False)
    return moving.getvalue()
