"""Colours of drawings that are made without matplotlib."""

import numpy as np
from matplotlib.colors import to_rgb

from critflow.pictures import TENSION_MAP
from critflow_extras.files.drawings import hexadecimal


def test_colours_without_matplotlib_are_those_of_figures():
    for place in np.linspace(0, 1, 7):
        assert np.abs(np.subtract(to_rgb(hexadecimal(place)), TENSION_MAP(float(place))[:3])).max() < 0.01
