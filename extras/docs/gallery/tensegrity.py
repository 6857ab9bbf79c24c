"""A tensegrity: cables and struts.

Six cables around a hexagon are stretched by three struts, which are dashed.
"""

import numpy as np

import critflow as cf
import critflow_extras as ce
from critflow_extras.tensegrity.signed_stress import signed_stress

angles = np.arange(6) * np.pi / 3
corners = np.column_stack([np.cos(angles), np.sin(angles)])
sides = [[i, (i + 1) % 6] for i in range(6)]
network = cf.Network([*sides, [0, 3], [1, 4], [2, 5]], pins={0: corners[0]})
found = signed_stress(network, corners, signs=[1] * 6 + [-1] * 3).value
stable = ce.stability(found.critical).super_stable
axes = ce.draw(
    found.critical,
    width=3,
    title="super stable" if stable else "not shown to be super stable",
)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("tensegrity.png", dpi=80)
