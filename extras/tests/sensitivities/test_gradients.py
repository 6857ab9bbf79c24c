"""Errors and gradients of properties at the transition against values and differences in sixty digits."""

from copy import copy

import numpy as np
import pytest
from problems import random_stress, with_random_stiffness

from critflow import CriticalManifold, InputError, critical_from_lengths, lattice, stiffening, voronoi_network
from critflow.deformation import DEFORMATIONS
from critflow_extras import properties
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import MP, dot, numbers, roots

NETWORK = with_random_stiffness(voronoi_network(n_vertices=8, seed=1), seed=2)
SIGMA = random_stress(NETWORK.n_edges, seed=5)
CHANGE = np.random.default_rng(7).normal(size=NETWORK.n_edges)
STEP = MP.mpf(10) ** -15
CRITICAL = CriticalManifold(NETWORK).configuration(SIGMA)


def closed_forms(sigma, k):
    """Quantities by their definitions in sixty digits."""
    found, springs = reference.configuration(NETWORK, sigma), copy(NETWORK)
    object.__setattr__(springs, "stiffness", k)
    _, _, C_B, C_G, _ = reference.stiffening(springs, found)
    L, volume = found.bond_vectors, reference.volume(NETWORK)
    stress = (sigma[:, None] * L).T @ L
    D = (sigma**2 * dot(L, L) / k).sum()
    lengths = roots(dot(L, L))
    V_L, V_tau = ((v**2).mean() / v.mean() ** 2 - 1 for v in (lengths, sigma * lengths))
    works = {"B_0": (stress[0, 0] + stress[1, 1]) / 2, "G_0": stress[0, 1], "modulus[uniaxial]": stress[0, 0]}
    moduli = {name: work**2 / (volume * D) for name, work in works.items()}
    return moduli | {"V_L": V_L, "V_tau": V_tau, "C_B": C_B, "C_G": C_G}


def difference(function):
    ahead, behind = function(STEP), function(-STEP)
    return {name: float((ahead[name] - behind[name]) / (2 * STEP)) for name in ahead}


def test_gradients_by_stress_and_stiffness_agree_with_differences_in_sixty_digits():
    sigma, k, change = numbers(SIGMA), numbers(NETWORK.stiffness), numbers(CHANGE)
    by_stress = difference(lambda h: closed_forms(sigma + h * change, k))
    by_stiffness = difference(lambda h: closed_forms(sigma, k + h * change))
    names = list(by_stress)
    found = properties(CRITICAL, names)
    for name in names:
        accuracy = 1e-11 if name in ("C_B", "C_G") else 1e-12
        assert found.by_stress[name] @ CHANGE * CRITICAL.sigma[0] / SIGMA[0] == pytest.approx(
            by_stress[name], rel=accuracy, abs=1e-15
        )
        assert found.by_stiffness[name] @ CHANGE == pytest.approx(by_stiffness[name], rel=accuracy, abs=1e-15)


@pytest.mark.parametrize("path", [name for name in DEFORMATIONS if name != "uniaxial_free"])
def test_stiffening_is_that_of_the_path(path):
    name = f"stiffening[{path}]"
    exact = stiffening(CRITICAL, deformation=path)
    assert properties(CRITICAL, name).values[name] == pytest.approx(exact.value.C, rel=1e-11, abs=1e-14)


def test_errors_are_those_of_sixty_digits_or_larger():
    """Errors from both sides: never below the true one, and less than 10,000 times the rounding of one operation."""
    for seed in range(5):
        critical = CriticalManifold(NETWORK).configuration(random_stress(NETWORK.n_edges, seed))
        exact = closed_forms(numbers(critical.sigma), numbers(NETWORK.stiffness))
        exact = {name: value for name, value in exact.items() if name not in ("C_B", "C_G")}
        found = properties(critical, list(exact))
        for name, value in exact.items():
            error = abs(MP.mpf(found.values[name]) - value)
            assert error <= found.errors[name] < 1e4 * np.finfo(float).eps * max(1.0, abs(float(value))), name


def test_the_error_of_a_small_variance_counts_the_rounding_of_lengths():
    # V_L = Σ(l − ⟨l⟩)²/N⟨l⟩² is about 1e-8, and changes by 2(l − ⟨l⟩)/N⟨l⟩² with a length: more than its own rounding.
    network = voronoi_network(n_vertices=40, seed=1)
    lengths = 1 + 1e-4 * np.random.default_rng(0).standard_normal(network.n_edges)
    critical = critical_from_lengths(network, lengths).value
    found, length = properties(critical, "V_L"), critical.lengths
    change = 2 * np.abs(length - length.mean()) / (len(length) * length.mean() ** 2)
    assert 3.9 < found.errors["V_L"] / (np.finfo(float).eps * change @ length) < 6


def test_slack_edges_have_no_gradient():
    # The value is that of the taut part; P is singular, and its solutions are no gradients.
    network = voronoi_network(100, seed=1)
    lengths = np.exp(0.3 * np.random.default_rng(0).standard_normal(network.n_edges))
    slack = critical_from_lengths(network, lengths, throw=False).value
    found = properties(slack, ["B_0", "C_B"])
    assert (slack.sigma == 0).any() and found.values["B_0"] > 0
    assert all(np.isnan(gradient).all() for gradient in found.by_stress.values())


@pytest.mark.parametrize(
    ("names", "word"), [(["colour"], "colour"), ([], "at least one"), (["stiffening[uniaxial_free]"], "uniaxial_free")]
)
def test_bad_input_is_one_sentence(names, word):
    with pytest.raises(InputError, match=word):
        properties(CRITICAL, names)
    rigid = lattice("triangular", 4, 4)
    with pytest.raises(InputError, match="self-stress"):
        properties(CriticalManifold(rigid).configuration(np.ones(48)), "B_0")
