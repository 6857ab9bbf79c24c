"""The picture of docs/theory/errors.md: python docs/pictures/errors.py [FILE]."""

import sys
from fractions import Fraction
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from critflow import CriticalManifold, elasticity, voronoi_network

exact = np.vectorize(Fraction, otypes=[object])


def solve(A, b):
    """A⁻¹ b of a positive definite matrix of rational numbers, by elimination."""
    A, b = A.copy(), b.copy()
    for j in range(len(A)):
        for i in range(len(A)):
            if i != j and A[i, j]:
                part = A[i, j] / A[j, j]
                A[i], b[i] = A[i] - part * A[j], b[i] - part * b[j]
    return b / np.diag(A)[:, None]


network = voronoi_network(n_vertices=20, seed=1)
manifold = CriticalManifold(network)
g = exact(network.incidence.toarray()[:, 1:].astype(int))
b = exact(network.offsets) @ exact(network.cell)
volume = abs(np.linalg.det(network.cell))
spreads, rows = np.arange(0, 9), []
for spread in spreads:
    stress = 10 ** (spread * np.random.default_rng(0).uniform(-0.5, 0.5, network.n_edges))
    critical = manifold.configuration(stress)
    sigma = exact(stress)[:, None]
    x = solve(g.T @ (sigma * g), -g.T @ (sigma * b))
    L = g @ x + b
    square = np.sum(L**2, axis=1)[:, None]
    bulk = np.sum(sigma * square) ** 2 / (4 * Fraction(volume) * np.sum(sigma**2 * square))
    moduli = elasticity(critical).value
    single = np.abs(x - exact(manifold.balance(stress).coordinates)).max()
    true = [np.abs(x - exact(critical.coordinates[1:])).max(), abs(bulk - Fraction(moduli.bulk)) / bulk]
    rows.append([*map(float, true), critical.error_bound, moduli.errors.bulk / moduli.bulk, float(single)])
errors = np.array(rows)
figure, axes = plt.subplots(figsize=(5, 3.2), layout="constrained")
axes.semilogy(spreads, errors[:, 4] / errors[:, 2], "x", color="0.4", label="coordinates without refinement")
for n, (name, marker, colour) in enumerate((("coordinates", "o", "#0072B2"), ("$B_0$", "D", "#D55E00"))):
    axes.semilogy(spreads, errors[:, n] / errors[:, n + 2], marker, linestyle="none", color=colour, label=name)
axes.axhline(1, color="k", linewidth=1)
axes.text(8.3, 1.3, "bound", ha="right", va="bottom", fontsize=9)
axes.set(xlabel="decades of stress", ylabel="error over its bound", ylim=(1e-3, 1e5))
axes.legend(frameon=False, fontsize=8, loc="upper left")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=80)
