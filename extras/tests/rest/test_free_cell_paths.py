"""Strain paths in cells with free components: without conjugate stress, floppy where springs can keep their lengths."""

import numpy as np
import pytest
from problems import critical_of, random_stress, stiff_lattice, with_random_stiffness

from critflow import (
    CriticalManifold,
    Deformation,
    InputError,
    Status,
    delaunay_network,
    equilibrium,
    lattice,
    spring_state,
    strain_path,
)
from critflow import voronoi_network as voronoi
from critflow.deformation import deformation_of
from critflow_extras import diluted, fibre_network, foam_network
from critflow_extras.rest.free_cell import stretched


@pytest.mark.parametrize("sign", [1, -1])
def test_modulus_and_stress_are_derivatives_of_the_relaxed_energy(sign):
    state, h, n = stiff_lattice(), 1e-3, 3
    strains = sign * h * np.arange(7)
    path = strain_path(state, strains, deformation="uniaxial_free").value
    F = path.deformation
    E, volume = path.energy, np.array([one.network.volume for one in path.states])
    # Sixth order.
    first = sign * (E[n + 3] - 9 * E[n + 2] + 45 * E[n + 1] - 45 * E[n - 1] + 9 * E[n - 2] - E[n - 3]) / (60 * h)
    second = np.array([2, -27, 270, -490, 270, -27, 2]) @ E / (180 * h**2)
    assert path.modulus[n] == pytest.approx(second / volume[n], rel=1e-7)
    # The work of the stress: free components do none.
    S = stretched(path.free_components[n], F.free_strains)
    rate = S @ F.velocity(strains[n]) @ np.linalg.inv(S)
    assert volume[n] * np.sum(path.stress[n] * rate) == pytest.approx(first, rel=1e-9, abs=1e-12)
    for strain, q, one in zip(strains, path.free_components, path.states, strict=True):
        boundary = state.network.boundary_vectors @ (stretched(q, F.free_strains) @ F.gradient(strain)).T
        np.testing.assert_allclose(one.network.boundary_vectors, boundary, rtol=0, atol=1e-14)
    assert not path.inserted.any() and path.steps.max() <= 4


@pytest.mark.parametrize("make", [lambda: voronoi(40, seed=1), lambda: foam_network(60, seed=1)], ids=["2D", "3D"])
def test_moduli_do_not_depend_on_tensors(make):
    critical = critical_of(make())
    few, all_ = (
        strain_path(critical, [0.01, 0.05], "uniaxial_free", measure=measure, throw=False)
        for measure in ("moduli", "tensors")
    )
    assert few.status is all_.status and few.value.elasticity == ()
    for name in ("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "modulus", "energy"):
        np.testing.assert_allclose(getattr(few.value, name), getattr(all_.value, name), rtol=1e-12, err_msg=name)


def test_the_path_back_returns_to_its_start():
    state, F = stiff_lattice(3), deformation_of("uniaxial_free", 2)
    there = strain_path(state, [0.02, 0.04], deformation=F).value
    total = stretched(there.free_components[-1], F.free_strains) @ F.gradient(0.04)
    back = strain_path(there.states[-1], [0.5, 1.0], deformation=np.linalg.inv(total) - np.eye(2)).value
    np.testing.assert_allclose(back.states[-1].bond_vectors, state.bond_vectors, rtol=0, atol=1e-13)
    assert back.energy[-1] == pytest.approx(state.energy, rel=1e-11)


def test_fire_is_refused():
    with pytest.raises(InputError, match="Newton"):
        strain_path(stiff_lattice(), [0.01], "uniaxial_free", method="fire")


def test_free_cell_in_space_has_no_stress():
    network = with_random_stiffness(delaunay_network(points=np.random.default_rng(1).random((12, 3))), 1)
    at_rest = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    state = equilibrium(spring_state(network, 0.98 * at_rest, network.positions)).value
    deformation = Deformation.uniaxial(3, sides="free").freeing("yy", "zz", "xy")
    path = strain_path(state, [0.0, 0.02, 0.05], deformation=deformation).value
    assert path.free_components.shape == (3, 3)
    assert (path.stress[1:, 0, 0] > 0.01).all() and (path.coordinate_error < 1e-12).all()
    for stress, q in zip(path.stress, path.free_components, strict=True):
        # Of the boundary (1 + Σ q E) F b the stress does the work V Σ_ij S_ij A_ij with A = E (1 + Σ q E)⁻¹.
        rates = deformation.free_strains @ np.linalg.inv(stretched(q, deformation.free_strains))
        np.testing.assert_allclose(np.einsum("ij,mij->m", stress, rates), 0, atol=1e-14)


@pytest.mark.parametrize("deformation", ["uniaxial_free", Deformation.simple_shear(2).freeing("yy")], ids=str)
@pytest.mark.parametrize("strain", [1e-3, 0.05, 0.2])
def test_free_sides_leave_a_critical_network_floppy(deformation, strain):
    critical = critical_of(voronoi(60, seed=2))
    ends = [strain_path(critical, [sign * strain], deformation=deformation, throw=False) for sign in (1, -1)]
    assert [end.status for end in ends] == [Status.floppy] * 2
    # On one side the strain loosens the network anyway; on the other one springs find a cell that keeps their lengths.
    assert sum("keep all lengths" in end.note for end in ends) == 1


@pytest.mark.parametrize("kind, deformation", [("kagome", "uniaxial"), ("kagome", "dilation"), ("phantom", "dilation")])
def test_straight_fibres_with_free_sides_keep_their_lengths(kind, deformation):
    # Lengths grow as the square of deflections, which forces do not feel: their balance leaves stresses of 1e-12.
    network = diluted(lattice("kagome", 6, 6), 3.5, 0) if kind == "kagome" else fibre_network("phantom", 8, 8, z=3.2)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, seed=0))
    path = getattr(Deformation, deformation)(2).freeing("yy")
    solution = strain_path(critical, [1e-3], path, throw=False)
    assert solution.status is Status.floppy and "keep all lengths" in solution.note
    # Gauss-Newton steps for |L| = ℓ in (x, q_yy).
    g, b = network.free_incidence.toarray(), network.boundary_vectors @ path.gradient(1e-3).T
    x, q = critical.coordinates[network.free], 0.0
    for _ in range(20):
        L = g @ x + b + q * b * [0, 1]
        length = np.linalg.norm(L, axis=1)
        n = L / length[:, None]
        rates = np.hstack([n[:, :1] * g, n[:, 1:] * g, (n[:, 1] * b[:, 1])[:, None]])
        step = np.linalg.lstsq(rates, critical.lengths - length, rcond=1e-10)[0]
        x, q = x + step[:-1].reshape(2, -1).T, q + step[-1]
    np.testing.assert_allclose(length, critical.lengths, rtol=1e-13)
