"""Pictures: few colours change nothing to see, every frame is there in order, and bytes repeat."""

import io

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image, ImageSequence

from critflow.workflow.pictures import FRAME, LAST_FRAME, gif, picture


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


def lines():
    """A figure of many thin lines in many shades."""
    figure = Figure(figsize=(3, 3), dpi=100)
    axes = figure.add_subplot()
    for number, angle in enumerate(np.linspace(0, np.pi, 120)):
        axes.plot([0, np.cos(angle)], [0, np.sin(angle)], color=str(0.8 * number / 120), linewidth=0.7)
    return figure


def test_few_colours_keep_the_picture_and_save_bytes():
    plain = io.BytesIO()
    lines().savefig(plain, format="png")
    small = picture(lines(), "png")
    before, after = (
        np.asarray(Image.open(io.BytesIO(b)).convert("RGB")).astype(int) for b in (plain.getvalue(), small)
    )
    assert before.shape == after.shape == (300, 300, 3)
    assert (after[0, 0] == 255).all()
    assert np.abs(before - after).max() < 32
    assert len(small) < 0.7 * len(plain.getvalue())
    assert picture(lines(), "png") == small
    assert b"Software" not in small


def test_shades_keep_all_their_colours():
    figure = Figure(figsize=(3, 3), dpi=100)
    x, y = np.meshgrid(np.linspace(0, 1, 200), np.linspace(0, 1, 200))
    figure.add_axes((0, 0, 1, 1)).imshow(np.stack([x, y, (x + y) % 1], axis=2))
    shown = np.asarray(Image.open(io.BytesIO(picture(figure, "png"))).convert("RGB"))
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 10_000


def test_other_formats_stay_as_they_are():
    assert picture(lines(), "pdf").startswith(b"%PDF")
    assert b"<svg" in picture(lines(), "svg")
