"""Steps of springs in tension: the numbers and bounds of general steps, and errors within these bounds."""

import numpy as np
import pytest
from problems import (
    critical_of,
    foam_network,
    partly_compressed,
    pinned_grid,
    random_stress,
    voronoi_3d,
    with_own_images,
)
from problems import with_random_stiffness as stiffened

from critflow import (
    CriticalManifold,
    Deformation,
    PowerLaw,
    WormLike,
    equilibrium,
    lattice,
    spring_state,
    strain_path,
)
from critflow import voronoi_network as voronoi
from critflow.deformation import deformation_of
from critflow.paths import Path
from critflow.sparse import Factor
from workflows.benchmarks import reference

NETWORKS = {
    "plane": lambda: stiffened(voronoi(60, seed=1), 1),
    "space": lambda: stiffened(voronoi_3d(), 1),
    "foam": lambda: foam_network(60, seed=1),
    "own images": with_own_images,
    "pins": lambda: pinned_grid().with_volume(2.0),
}
# Shears compress springs of the other two networks.
CASES = [(name, F) for name in ("plane", "space", "foam") for F in ("dilation", "simple_shear", "turning")]
CASES += [("own images", "dilation"), ("pins", "dilation")]
STRAINS = np.array([1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 0.05])
NUMBERS = (
    *("energy", "bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "modulus", "stress"),
    "total_strains",
)
BOUNDS = "coordinate_error", "bulk_modulus_error", "shear_modulus_error", "modulus_error"


def turning(gamma):
    """A deformation whose rate turns, in the plane or in space."""
    return np.array([[np.exp(gamma), gamma], [0.3 * gamma**2, 1.0]])


@pytest.fixture
def lean(monkeypatch):
    """Whether each step was lean; `lean.off()` makes the later ones general."""
    taken, step = [], Path.lean_step

    def counted(path, strain, change):
        end = None if taken.general else step(path, strain, change)
        taken.append(end is not None)
        return end

    class Taken(list):
        general = False

        def off(self):
            self.general = True

    taken = Taken()
    monkeypatch.setattr(Path, "lean_step", counted)
    return taken


def assert_same(one, other):
    """The same steps and numbers, and bounds of the same size."""
    for name in ("steps", "inserted", "status"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in NUMBERS:
        number, size = getattr(other, name), np.abs(getattr(other, name)).max()
        np.testing.assert_allclose(getattr(one, name), number, rtol=1e-12, atol=1e-14 * size, err_msg=name)
    for name in BOUNDS:
        ratio = getattr(one, name) / getattr(other, name)
        assert 0.7 < ratio.min() and ratio.max() < 1.25, (name, ratio)
    for here, there in zip(one.states, other.states, strict=True):
        np.testing.assert_allclose(here.bond_vectors, there.bond_vectors, rtol=0, atol=1e-13)
        np.testing.assert_allclose(here.coordinates, there.coordinates, rtol=0, atol=1e-13)
    for here, there in zip(one.elasticity, other.elasticity, strict=True):
        for name in ("tensor", "affine"):
            size = np.abs(getattr(there, name)).max()
            np.testing.assert_allclose(getattr(here, name), getattr(there, name), rtol=0, atol=1e-12 * size)
        ratio = here.errors.tensor / there.errors.tensor
        assert 0.7 < ratio.min() and ratio.max() < 1.25, ratio


LAWS = [None, PowerLaw(4), WormLike(2.0)]
MEASURED = [("tensors", law) for law in LAWS] + [("moduli", None)]
MEASURED += [pytest.param("moduli", law, marks=pytest.mark.sweep) for law in LAWS[1:]]


@pytest.mark.parametrize("measure, law", MEASURED, ids=str)
@pytest.mark.parametrize("name, deformation", CASES)
def test_lean_steps_have_the_numbers_of_general_ones(lean, name, deformation, law, measure):
    network = NETWORKS[name]()
    F = deformation
    if deformation == "turning":
        F = (
            Deformation.path(turning, 2)
            if network.dimension == 2
            else Deformation.exponential(np.eye(3) + np.eye(3, k=1))
        )
    start = critical_of(network)
    # The sign that tightens: a strain of the other one is floppy.
    L, A = start.bond_vectors, deformation_of(F, network.dimension).velocity(0.0)
    strains = STRAINS * np.sign((start.sigma[:, None] * L * (L @ A.T)).sum())
    one = strain_path(start, strains, F, law=law, measure=measure).value
    assert sum(lean) >= len(STRAINS) - 2
    lean.off()
    assert_same(one, strain_path(start, strains, F, law=law, measure=measure).value)


def test_a_stressed_state_takes_lean_steps(lean):
    network = stiffened(lattice("triangular", 4, 4), 1)
    rest = 0.9 * np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    state, strains = equilibrium(spring_state(network, rest, network.positions)).value, [0.0, 1e-3, 0.02, 0.1]
    one = strain_path(state, strains, "pure_shear").value
    assert lean == [False, True, True, True]
    lean.off()
    assert_same(one, strain_path(state, strains, "pure_shear").value)


def test_errors_of_lean_steps_are_within_their_bounds(lean):
    # Responses of the last steps are extrapolated and corrected once.
    network = stiffened(voronoi(12, seed=1), 2)
    critical = CriticalManifold(network).configuration(random_stress(18, 4))
    for strains in (1e-3 * np.arange(1, 9), 1e-9 * np.arange(1, 9), 0.05 * np.arange(1, 9)):
        path = strain_path(critical, strains).value
        for n, state in enumerate(path.states):
            exact = reference.equilibrium(state.network, state.rest_lengths, state.coordinates)
            error = reference.largest_error(state.coordinates, exact.coordinates, moved=True)
            assert error <= path.coordinate_error[n] <= 20 * error
            bulk, shear, corrected = reference.linear_response(state.network, exact.bond_vectors, state.rest_lengths)
            assert abs(path.bulk_modulus[n] - bulk) <= path.bulk_modulus_error[n]
            assert abs(path.shear_modulus[n] - shear) <= path.shear_modulus_error[n]
            assert abs(path.shear_modulus_stress_corrected[n] - corrected) <= path.shear_modulus_error[n]
    assert sum(lean) >= 22


def test_later_steps_solve_once_for_each_strain(lean, monkeypatch):
    start, solve, solves = critical_of(voronoi(60, seed=1)), Factor.solve, []
    monkeypatch.setattr(Factor, "solve", lambda *arguments: solves.append(len(lean)) or solve(*arguments))
    strain_path(start, 3e-3 * np.arange(1, 11))
    # Two corrections of coordinates and one of each response; a step is counted at its end.
    assert all(lean) and [solves.count(n) for n in range(5, 10)] == 5 * [5]


@pytest.mark.parametrize("name", ["compressed", "fire", "not convex"])
def test_other_paths_take_general_steps(lean, name):
    start, options = critical_of(voronoi(20, seed=2)), {}
    if name == "compressed":
        start = partly_compressed(20, 12)
    elif name == "fire":
        options = {"method": "fire"}
    else:
        options = {"law": type("Softening", (PowerLaw,), {"convex": False})(2.5)}
    assert strain_path(start, [0.01, 0.02], **options).ok
    assert lean and not any(lean)


@pytest.mark.parametrize("name", ["periodic", "no volume"])
def test_an_equilibrium_does_not_depend_on_what_is_measured(lean, name):
    start = critical_of(pinned_grid() if name == "no volume" else voronoi(20, seed=2))
    ends = [strain_path(start, [0.01], measure=measure).value.states[0] for measure in ("energy", "moduli", "tensors")]
    assert all(lean) and len(lean) == 3
    for other in ends[1:]:
        np.testing.assert_array_equal(other.coordinates, ends[0].coordinates)
