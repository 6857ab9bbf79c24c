"""Networks of the literature.

Each generator takes a seed, and prunes to the part that can carry tension.
"""

import matplotlib.pyplot as plt

import critflow as cf
import critflow_extras as ce

networks = {
    "diluted kagome": ce.diluted(cf.lattice("kagome", 6, 6), z=3.4, seed=1),
    "phantom": ce.fibre_network("phantom", 10, 10, z=3.4, seed=1),
    "Delaunay": ce.diluted(cf.delaunay_network(80, seed=1), z=4.2, seed=1),
    "packing": ce.packing_network(80, z=4.5, seed=1),
    "random regular": ce.regular_network(80, z=3, seed=1),
    "oblique Voronoi": cf.voronoi_network(
        100, seed=1, cell=[[1.5, 0.0], [0.6, 1.0]]
    ),
}
figure, grid = plt.subplots(2, 3, figsize=(6.4, 4.6), layout="constrained")
for axes, (title, network) in zip(grid.flat, networks.items(), strict=True):
    ce.draw(
        network,
        axes,
        title=title,
        width=0.8,
    )
figure.savefig("networks.png", dpi=75)
