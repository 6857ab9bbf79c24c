"""Gradients of properties at the transition and of the onset, against differences in sixty digits."""

import numpy as np
import pytest
from problems import random_stress, with_random_stiffness

from critflow import (
    CriticalManifold,
    InputError,
    critical_from_lengths,
    critical_strain,
    lattice,
    properties,
    stiffening,
    voronoi_network,
)
from critflow.design.problem import Nearness
from critflow.design.stresses import Stresses
from critflow.networks.deformation import DEFORMATIONS
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import MP, dot, largest, numbers, roots, solve

NETWORK = with_random_stiffness(voronoi_network(n_vertices=8, seed=1), seed=2)
SIGMA = random_stress(NETWORK.n_edges, seed=5)
CHANGE = np.random.default_rng(7).normal(size=NETWORK.n_edges)
STEP = MP.mpf(10) ** -15
CRITICAL = CriticalManifold(NETWORK).configuration(SIGMA)


def closed_forms(sigma, k):
    """Moduli, variances and S_xy/√D by their definitions, and Σ|x + c|² of the coordinates about their mean."""
    found = reference.configuration(NETWORK, sigma)
    L, volume = found.bond_vectors, reference.volume(NETWORK)
    stress = (sigma[:, None] * L).T @ L
    D = (sigma**2 * dot(L, L) / k).sum()
    lengths, x = roots(dot(L, L)), found.coordinates - found.coordinates.mean(axis=0)
    variances = [(v**2).mean() / v.mean() ** 2 - 1 for v in (lengths, sigma * lengths)]
    works = {"B_0": (stress[0, 0] + stress[1, 1]) / 2, "G_0": stress[0, 1], "modulus[uniaxial]": stress[0, 0]}
    moduli = {name: work**2 / (volume * D) for name, work in works.items()}
    others = {"S_xy": stress[0, 1] / MP.sqrt(D), "V_L": variances[0], "V_tau": variances[1], "x": (x**2).sum()}
    return moduli | others


def difference(function):
    ahead, behind = function(STEP), function(-STEP)
    return {name: float((ahead[name] - behind[name]) / (2 * STEP)) for name in ahead}


def test_gradients_by_stress_and_stiffness_agree_with_differences_in_sixty_digits():
    sigma, k, change = numbers(SIGMA), numbers(NETWORK.stiffness), numbers(CHANGE)
    by_stress = difference(lambda h: closed_forms(sigma + h * change, k))
    by_stiffness = difference(lambda h: closed_forms(sigma, k + h * change))
    names = [name for name in by_stress if name != "x"]
    found = properties(CRITICAL, names)
    for name in names:
        assert found.by_stress[name] @ CHANGE * CRITICAL.sigma[0] / SIGMA[0] == pytest.approx(
            by_stress[name], rel=1e-12, abs=1e-15
        )
        assert found.by_stiffness[name] @ CHANGE == pytest.approx(by_stiffness[name], rel=1e-12, abs=1e-15)
    # The distance from positions at the origin, whose gradient `design` uses.
    stresses = Stresses(CriticalManifold(NETWORK), SIGMA, signs="any")
    size = SIGMA[0] / stresses.start[0]
    gradient = 2 * 8 * Nearness(stresses, np.zeros((8, 2))).at(stresses.at(stresses.origin), stresses.origin)[1] / size
    assert gradient @ CHANGE == pytest.approx(by_stress["x"], rel=1e-12)


@pytest.mark.parametrize("path", [name for name in DEFORMATIONS if name != "uniaxial_free"])
def test_stiffening_is_that_of_the_path(path):
    name = f"stiffening[{path}]"
    exact = stiffening(CRITICAL, deformation=path)
    assert properties(CRITICAL, name).values[name] == pytest.approx(exact.value.C, rel=1e-11, abs=1e-14)


def exact_onset(network, lengths, start):
    """γ_c in simple shear by Newton's method: |L| = ℓ and force balance, with Σσ = N_b."""
    g, b, n = reference.incidence(network), numbers(network.boundary_vectors), 2 * len(network.free)
    m, A = network.n_edges, numbers([[0.0, 1.0], [0.0, 0.0]])
    x = numbers(start.configuration.coordinates[network.free] - start.configuration.coordinates[0])
    sigma, gamma = numbers(start.configuration.sigma), MP.mpf(start.strain)
    sigma = sigma * m / sigma.sum()
    while True:
        rate = b @ A.T
        L = g @ x + b + gamma * rate
        R = (g[:, :, None] * L[:, None, :]).reshape(m, n)
        matrix = numbers(np.zeros((n + m + 1, n + m + 1)))
        matrix[:n, :n], matrix[:n, n:-1], matrix[n:-1, :n] = reference.laplacian(network, sigma, 2), R.T, R
        matrix[:n, -1], matrix[n:-1, -1] = (g.T @ (sigma[:, None] * rate)).ravel(), dot(L, rate)
        matrix[-1, n:-1] = 1
        force, short = (g.T @ (sigma[:, None] * L)).ravel(), (lengths**2 - dot(L, L)) / 2
        step = solve(matrix, np.concatenate([-force, short, [m - sigma.sum()]])[:, None])[:, 0]
        x, sigma, gamma = x + step[:n].reshape(-1, 2), sigma + step[n:-1], gamma + step[-1]
        if largest(step) < 1e-30:
            return gamma


def test_the_gradient_of_the_onset_agrees_with_differences_in_sixty_digits():
    lengths = np.full(12, 1.02 * critical_from_lengths(NETWORK, np.ones(12), throw=False).ratio)
    onset = critical_strain(NETWORK, lengths, "simple_shear")
    change, h = numbers(CHANGE), MP.mpf(10) ** -12
    ahead, behind = (exact_onset(NETWORK, numbers(lengths) + sign * h * change, onset) for sign in (1, -1))
    assert onset.strain == pytest.approx(float(ahead), abs=1e-10)
    assert onset.gradient @ CHANGE == pytest.approx(float((ahead - behind) / (2 * h)), rel=1e-8)


@pytest.mark.parametrize(
    ("names", "word"),
    [(["colour"], "colour"), ([], "at least one"), (["stiffening[uniaxial_free]"], "uniaxial_free")],
)
def test_bad_input_is_one_sentence(names, word):
    with pytest.raises(InputError, match=word):
        properties(CRITICAL, names)
    rigid = lattice("triangular", 4, 4)
    with pytest.raises(InputError, match="self-stress"):
        properties(CriticalManifold(rigid).configuration(np.ones(48)), "B_0")
