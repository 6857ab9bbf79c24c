"""Deformations: gradients, derivatives, volumes, free components and refused input."""

import numpy as np
import pytest
from derivatives import assert_derivative

from critflow import Deformation, InputError
from critflow.deformation import DEFORMATIONS, deformation_of, strain_basis

A = np.array([[0.3, -0.8], [0.1, 0.5]])


def turned(strain):
    c, s = np.cos(strain), np.sin(strain)
    return np.array([[c, -s], [s, c]]) @ np.diag([1 + strain, 1 + strain**2])


def turned_rate(strain):
    c, s = np.cos(strain), np.sin(strain)
    turn, rate = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
    return rate @ np.diag([1 + strain, 1 + strain**2]) + turn @ np.diag([1, 2 * strain])


PATHS = {
    **{f"{name} {d}": deformation_of(name, d) for name in DEFORMATIONS for d in (2, 3)},
    "shear zx": Deformation.simple_shear(3, "zx"),
    "pure shear yz": Deformation.pure_shear(3, "yz"),
    "matrix": deformation_of(A, 2),
    "exponential": Deformation.exponential(A),
    "function": deformation_of(turned, 2),
    "function with its rate": Deformation.path(turned, 2, turned_rate),
}


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
@pytest.mark.parametrize("strain", [-0.2, 0.0, 0.3])
def test_derivatives_are_those_of_the_gradient(path, strain):
    here = path.gradient(strain)
    assert_derivative(path.gradient, lambda u: u * path.rate(strain), strain, [1.0], atol=1e-9)
    assert_derivative(path.rate, lambda u: u * path.second_rate(strain), strain, [1.0], atol=1e-9)
    np.testing.assert_allclose(path.velocity(strain) @ here, path.rate(strain), rtol=0, atol=1e-14)
    np.testing.assert_allclose(path.acceleration(strain) @ here, path.second_rate(strain), rtol=0, atol=1e-13)
    assert path.linear_in_strain <= (np.abs(path.second_rate(strain)).max() == 0)
    np.testing.assert_array_equal(path.gradient(0.0), np.eye(path.dimension))


def bent(of, strain=0.0):
    """F = diag(1 + `of`(γ − strain), 1), zero at γ = 0."""
    return lambda gamma: np.diag([1 + of(gamma - strain) - of(-strain), 1.0])


def step(gamma):
    return np.diag([float(gamma >= 0), 0.0])


@pytest.mark.parametrize(
    "path, strain",
    [
        (bent(lambda g: max(g, 0.0)), 0.0),
        (bent(abs), 1e-6),
        (bent(lambda g: g + 2 * max(g, 0.0), 0.05), 0.05),
        (bent(lambda g: g + max(g, 0.0) ** 2), 0.0),
        (bent(lambda g: g if g >= 0 else np.nan), 0.0),
        (bent(lambda g: np.sin(1e6 * g) / 1e6), 0.0),
    ],
    ids=["from zero", "near a kink", "kink", "curved from zero", "undefined below", "fast"],
)
def test_derivatives_that_differences_do_not_find_are_refused_and_may_be_given(path, strain):
    for derivative in (Deformation.path(path, 2).rate, Deformation.path(path, 2).second_rate):
        with pytest.raises(InputError, match="not smooth"):
            derivative(strain)
    one_sided = Deformation.path(bent(lambda g: max(g, 0.0)), 2, step, lambda gamma: np.zeros((2, 2)))
    assert (one_sided.rate(0.0)[0, 0], one_sided.second_rate(0.0)[0, 0], one_sided.perturbed) == (1, 0, ())


def test_steps_become_shorter_next_to_a_kink():
    for path, strain in ((bent(lambda g: max(g, 0.0)), 1e-3), (bent(lambda g: g + 2 * max(g, 0.0), 0.05), 0.049)):
        path = Deformation.path(path, 2)
        assert path.rate(strain)[0, 0] == pytest.approx(1.0, abs=1e-9)
        error = path.error(path.second_rate(strain), lambda other, at=strain: other.second_rate(at))
        assert abs(path.second_rate(strain)[0, 0]) < error[0, 0] < 1e-3


@pytest.mark.parametrize("d", [2, 3])
def test_volumes(d):
    volume = {name: np.linalg.det(deformation_of(name, d).gradient(0.3)) for name in DEFORMATIONS}
    expected = {"dilation": 1.3, "simple_shear": 1.0, "pure_shear": 1.0, "uniaxial": 1.3, "uniaxial_free": 1.3}
    assert volume == pytest.approx(expected, rel=1e-14)


def test_rates_follow_the_conventions():
    np.testing.assert_array_equal(Deformation.simple_shear(2).gradient(0.1) @ [0, 1], [0.1, 1])
    np.testing.assert_array_equal(Deformation.pure_shear(2).rate(0.0), np.diag([1, -1]))
    np.testing.assert_allclose(Deformation.dilation(3).rate(0.0), np.eye(3) / 3)


def test_free_components():
    assert Deformation.uniaxial(2, sides="free").free == ("yy",)
    path = Deformation.uniaxial(3, "y", sides="free")
    assert (path.name, path.free) == ("uniaxial_free_y", ("xx", "zz"))
    free = Deformation.simple_shear(3).freeing("zz", "yx", "xy")
    assert free.free == ("zz", "xy")
    np.testing.assert_array_equal(free.free_strains[1], [[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]])
    names, strains = strain_basis(3)
    assert names == ("xx", "yy", "zz", "yz", "xz", "xy")
    assert np.linalg.matrix_rank(strains.reshape(6, 9)) == 6
    assert strain_basis(2)[0] == ("xx", "yy", "xy") and strain_basis(1)[0] == ("xx",)


@pytest.mark.parametrize(("plane", "name"), [("xy", "pure_shear"), ("xz", "pure_shear_xz"), ("yz", "pure_shear_yz")])
def test_a_pure_shear_names_its_plane_but_for_the_first(plane, name):
    assert Deformation.pure_shear(3, plane).name == name
