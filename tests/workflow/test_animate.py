"""Animations: every frame is there, in order, and the same figures give the same bytes."""

import io

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image, ImageSequence

from critflow.workflow.animate import FRAME, LAST_FRAME, gif


def bars(heights):
    """A frame for each height: a black bar on white whose share of the picture is the height."""
    for height in heights:
        figure = Figure(figsize=(1, 1), dpi=50)
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set(xlim=(0, 1), ylim=(0, 1))
        axes.fill_between([0, 1], [height, height], color="black", linewidth=0)
        yield figure


def test_every_frame_is_there_in_its_order():
    heights = (0.2, 0.9, 0.4, 0.6)
    moving = Image.open(io.BytesIO(gif(bars(heights))))
    assert (moving.n_frames, moving.info["loop"]) == (4, 0)
    dark, shown = [], []
    for frame in ImageSequence.Iterator(moving):
        shown.append(frame.info["duration"])
        dark.append(1 - np.asarray(frame.convert("L")).mean() / 255)
    np.testing.assert_allclose(dark, heights, atol=0.02)  # a row of pixels
    assert shown == [FRAME, FRAME, FRAME, LAST_FRAME]


def test_the_same_figures_give_the_same_bytes():
    assert gif(bars((0.1, 0.7))) == gif(bars((0.1, 0.7)))


def test_no_frames_are_an_error():
    with pytest.raises(ValueError, match="at least one frame"):
        gif(())
