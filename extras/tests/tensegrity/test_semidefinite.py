"""The two relaxations against forms whose common zeros, or definite combinations, are known."""

import numpy as np
import pytest

from critflow_extras.tensegrity.semidefinite import fourth_order_bound, second_order_relaxation

SADDLES = np.array([[[1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [1.0, 0.0]]])


def random_forms(n_forms, n, seed):
    forms = np.random.default_rng(seed).standard_normal((n_forms, n, n))
    return forms + forms.transpose(0, 2, 1)


@pytest.mark.parametrize(("n_forms", "n"), [(1, 1), (1, 4), (2, 3), (3, 10), (5, 30), (9, 3)])
def test_a_definite_combination_is_found_and_proved_best(n_forms, n):
    forms = random_forms(n_forms, n, seed=n)
    forms[0] += 4 * np.sqrt(n) * np.eye(n)
    answer = second_order_relaxation(forms)
    assert answer.solved
    assert np.linalg.norm(answer.multipliers) == pytest.approx(1, abs=1e-8)
    # Duality: no X comes closer to zero than the least eigenvalue of the best combination.
    least = np.linalg.eigvalsh(np.tensordot(answer.multipliers, forms, 1))[0]
    assert least == pytest.approx(answer.bound, rel=1e-8)
    X = answer.moments
    assert np.linalg.norm(np.tensordot(forms, X, 2)) == pytest.approx(answer.bound, rel=1e-7)
    assert np.trace(X) == pytest.approx(1, abs=1e-9)
    assert np.linalg.eigvalsh(X)[0] > -1e-8


def test_two_saddles_have_no_definite_combination_and_no_common_zero():
    answer = second_order_relaxation(SADDLES)
    assert abs(answer.bound) < 1e-9
    np.testing.assert_allclose(answer.moments, np.eye(2) / 2, atol=1e-8)
    # By hand: with moments a = ⟨x⁴⟩ = ⟨y⁴⟩, b = ⟨x²y²⟩ and a + b = ½ it is 2(a − b)² + 4b², least at b = 1/6.
    assert fourth_order_bound(SADDLES) == pytest.approx(1 / np.sqrt(6), rel=1e-6)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_a_common_zero_leaves_no_bound(n):
    # Forms turned so that all vanish at one unit vector.
    forms, z = random_forms(n, n, seed=n), np.ones(n) / np.sqrt(n)
    forms -= (forms @ z @ z)[:, None, None] * np.eye(n)
    assert np.abs(forms @ z @ z).max() < 1e-12
    assert second_order_relaxation(forms).bound < 1e-8
    assert fourth_order_bound(forms) < 1e-7


@pytest.mark.parametrize("n", [2, 3, 4])
def test_the_fourth_order_bounds_from_below(n):
    forms = random_forms(2 * n, n, seed=10 + n)
    # Traceless forms have no definite combination: X = 1/n speaks against each.
    forms -= np.trace(forms, axis1=1, axis2=2)[:, None, None] / n * np.eye(n)
    assert abs(second_order_relaxation(forms).bound) < 1e-8
    bound = fourth_order_bound(forms)
    assert bound > 0.1
    z = np.random.default_rng(0).standard_normal((2000, n))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    products = np.stack([z[:, i] * z[:, j] for i in range(n) for j in range(i, n)])
    work = np.einsum("kij,zi,zj->kz", forms, z, z)
    assert (np.linalg.norm(products, axis=0) * np.linalg.norm(work, axis=0)).min() >= bound * (1 - 1e-6)
