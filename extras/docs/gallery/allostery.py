"""A network that answers where you want.

One source, black, commands fifteen faces: each is to grow or to shrink with it.
Arrows are the motion at vanishing stress, before and after the design.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
import critflow_extras as ce
from critflow_extras.local.diagonals import face_diagonals, response_name
from critflow_extras.local.drawing import draw_response, response_legend

network = cf.voronoi_network(n_vertices=80, seed=4)
pairs = face_diagonals(network)
source, targets = pairs[31], pairs[1:30:2]  # the source is in the middle
wanted = np.resize([1.0, -1.0], len(targets))
names = [response_name(source, target) for target in targets]
before = cf.optimize(network, "B_0").value
after = ce.design(network, dict(zip(names, wanted, strict=True))).value

figure, row = plt.subplots(1, 2, figsize=(7, 3.7), layout="constrained")
for axes, critical, title in zip(
    row, (before, after), ("stiffest network", "trained"), strict=True
):
    found = ce.local_response(critical, source, targets).value
    draw_response(critical, found, axes)
    worst = f"{np.abs(found.strains - wanted).max():.1g}".replace("-", "−")
    axes.set_title(f"{title}: largest error {worst}", fontsize=10)
figure.legend(
    handles=response_legend(),
    ncols=3,
    frameon=False,
    loc="outside lower center",
)
figure.savefig("allostery.png", dpi=90)
