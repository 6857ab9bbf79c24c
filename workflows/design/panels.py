"""Parts of the figures that the modules of this study share."""

from __future__ import annotations

from matplotlib.figure import Figure


def panels(n, title, height=3.6):
    """A figure with n panels side by side, as wide as a page, and the panels."""
    drawn = Figure(figsize=(10, height), dpi=150, layout="constrained")
    row = drawn.subplots(1, n)
    for axes in row:
        axes.spines[["top", "right"]].set_visible(False)
    drawn.suptitle(title, fontsize=11)
    return drawn, row


def limit(axes, value, label):
    """A dotted line at the largest value that is allowed."""
    axes.axhline(value, color="k", linewidth=0.8, linestyle=":")
    axes.text(0.02, value, label, va="bottom", fontsize=8.5, transform=axes.get_yaxis_transform())


def times(axes, distance, seconds, **style):
    """Processor times of designs against their changes of stress."""
    axes.scatter(distance, seconds, s=16, **style)
    axes.set(xlabel="change of $\\log\\sigma$ (r.m.s.)", ylabel="processor time  [s]", title="time of one design")


def signed(value):
    """A number with the sign of typography."""
    return f"{value:g}".replace("-", "−")
