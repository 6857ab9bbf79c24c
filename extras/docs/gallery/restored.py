"""Tensions from a picture.

The coordinates have errors; the nearest critical configuration gives back the
tensions with standard errors.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
import critflow_extras as ce

network = cf.voronoi_network(n_vertices=60, seed=1)
rng = np.random.default_rng(1)
truth = cf.CriticalManifold(network).configuration(
    np.exp(0.3 * rng.standard_normal(network.n_edges))
)
seen = truth.coordinates + 0.01 * rng.standard_normal(truth.coordinates.shape)
fit = ce.nearest_critical(network, seen, error=0.01)
figure, axes = plt.subplots(figsize=(4.4, 4.2), layout="constrained")
sigma = fit.value.sigma
axes.errorbar(
    truth.sigma,
    sigma,
    sigma * fit.stress_error,
    fmt=".",
    color="#0072B2",
    elinewidth=0.7,
)
axes.axline((1, 1), slope=1, color="0.5", linewidth=0.8)
axes.set(xlabel="true σ", ylabel="σ from the picture", aspect="equal")
figure.savefig("restored.png", dpi=80)
