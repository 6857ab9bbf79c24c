"""Steps of a strain path: their number, branches, budgets and predictions."""

import numpy as np
import pytest
from problems import critical_of, partly_compressed, relaxed_directly, stiff_lattice

from critflow import (
    CriticalManifold,
    SolveError,
    Status,
    WormLike,
    critical_from_lengths,
    lattice,
    paths,
    spring_state,
    strain_path,
)
from critflow import voronoi_network as voronoi
from critflow.deformation import deformation_of
from critflow.paths import Path, PathPoint


def test_path_ends_with_the_range_of_its_law():
    # With σ = k the edges of equal law reach their contour length together, at the volume (1 + m)².
    critical = CriticalManifold(voronoi(40, seed=1)).configuration(np.ones(60))
    law, strains = WormLike(0.02), 0.002 * np.arange(1, 26)
    solution = strain_path(critical, strains, law=law, throw=False)
    assert solution.status is Status.stalled
    path = solution.value
    assert len(path.states) == 20 and path.status[21] == Status.missing
    assert path.steps[3:19].max() <= 4
    assert path.strains[19] < 1.02**2 - 1 < path.strains[20]
    assert (np.diff(path.bulk_modulus[:20]) > 0).all()
    assert np.isnan(path.bulk_modulus[20:]).all()
    with pytest.raises(SolveError, match=r"0\.042"):
        strain_path(critical, strains, law=law)


@pytest.mark.parametrize("measure", ["tensors", "energy"])
@pytest.mark.parametrize("end", [0.1, 0.5])
def test_one_step_equals_many_steps(end, measure):
    critical = critical_of(voronoi(40, seed=1))
    one = strain_path(critical, [end], measure=measure).value
    many = strain_path(critical, np.linspace(0, end, 51)[1:]).value
    np.testing.assert_allclose(one.states[-1].bond_vectors, many.states[-1].bond_vectors, rtol=0, atol=1e-13)
    # Without compression the equilibrium is unique and no step is inserted.
    assert (one.states[-1].extension > 0).all()
    assert not one.inserted.any() and not many.inserted.any()


def test_close_strains_are_predicted_to_rounding():
    """By three points, where they predict better than two: equilibria without a step of Newton's method."""
    path = strain_path(critical_of(voronoi(40, seed=1)), np.linspace(0.01, 0.5, 25)).value
    assert path.steps[:2].all() and not path.steps[15:].any() and path.max_force.max() < 1e-13


@pytest.mark.parametrize("end", [0.1, 0.5])
def test_one_step_follows_the_branch_of_many_steps(end):
    critical = partly_compressed(20, 12)
    one = strain_path(critical, [end]).value
    many = strain_path(critical, np.linspace(0, end, 101)[1:]).value
    np.testing.assert_allclose(one.states[-1].bond_vectors, many.states[-1].bond_vectors, rtol=0, atol=1e-12)
    assert one.bulk_modulus[-1] == pytest.approx(many.bulk_modulus[-1], rel=1e-11)
    assert one.inserted[0] > 0 and len(one.states) == 1 and (one.states[-1].extension < 0).any()
    # Relaxed at once, Newton's method ends in another equilibrium.
    direct = relaxed_directly(critical, end)
    assert np.abs(direct.bond_vectors - one.states[-1].bond_vectors).max() > 0.1


@pytest.mark.parametrize("n_vertices, seed", [(12, 5), pytest.param(40, 11, marks=pytest.mark.sweep)])
def test_end_of_a_branch_is_reported(n_vertices, seed):
    critical = partly_compressed(n_vertices, seed)
    # There are equilibria beyond, but no continuous path to them.
    assert relaxed_directly(critical, 0.5).max_force < 1e-12
    for strains in ([0.5], np.linspace(0, 0.5, 51)[1:]):
        solution = strain_path(critical, strains, throw=False)
        assert solution.status in (Status.unstable, Status.step_limit, Status.stalled, Status.ill_conditioned)
        assert np.isnan(solution.value.energy[-1]) and np.isnan(solution.value.coordinate_error[-1])


@pytest.mark.parametrize("deformation", ["simple_shear", "pure_shear", "uniaxial"])
def test_the_path_back_returns_to_its_start(deformation):
    state = stiff_lattice(3)
    F = deformation_of(deformation, 2)
    there = strain_path(state, [0.02, 0.04], deformation=F).value
    total = F.gradient(0.04)

    last = there.states[-1]
    back = strain_path(last, [0.5, 1.0], deformation=np.linalg.inv(total) - np.eye(2)).value
    np.testing.assert_allclose(back.states[-1].bond_vectors, state.bond_vectors, rtol=0, atol=1e-13)
    assert back.energy[-1] == pytest.approx(state.energy, rel=1e-11)


@pytest.mark.parametrize("strain", [5e-324, 1e-320, 1e-310, 1e-17])
def test_strains_below_the_rounding_of_the_cell_end_at_once(strain):
    solution = strain_path(critical_of(voronoi(16, seed=5100)), [strain], throw=False)
    assert solution.status is Status.ill_conditioned
    assert solution.value.inserted[0] == 0


@pytest.mark.parametrize("measure", ["tensors", "energy"])
def test_the_velocity_at_a_transition_is_found_where_it_is_needed(measure):
    # The affinely deformed network is unstable at any strain, however small.
    critical = partly_compressed(20, 2)
    strains = [6.4e-8, 1.2e-7, 7.2e-6, 9e-5, 3e-4]
    solution = strain_path(critical, strains, measure=measure, deformation="pure_shear")
    assert solution.ok and not solution.value.inserted.any()


def test_no_strain_exceeds_its_budget(monkeypatch):
    # Steps beyond a fixed length fail, so that strides never grow.
    critical, steps = critical_of(voronoi(8, seed=1)), []
    monkeypatch.setattr(paths, "_MOST_STEPS", 50)
    step_to = Path.step_to

    def short_ones(path, strain, change):
        steps.append(abs(strain - path.points[-1].strain))
        end = step_to(path, strain, change)
        return end if steps[-1] < 2e-6 else end.refused(Status.unstable, "too far")

    monkeypatch.setattr(Path, "step_to", short_ones)
    solution = strain_path(critical, [0.01, 0.02], throw=False)
    assert solution.status is Status.step_limit and "closer" in solution.note
    assert len(steps) <= 50


def test_slack_parts_do_not_shorten_the_steps():
    # Slack edges are springs at rest in floppy parts, of which a few are compressed by 1e-9.
    network = voronoi(200, seed=5)
    lengths = np.random.default_rng(5).uniform(0.3, 1.7, network.n_edges)
    critical = critical_from_lengths(network, lengths, throw=False)
    assert len(critical.slack_edges) > 100
    path = strain_path(critical, np.linspace(0.001, 0.01, 10), taut_only=True).value
    assert path.inserted.sum() < 20 and path.steps.sum() < 200
    other = strain_path(critical, [0.0013, 0.01], taut_only=True).value
    np.testing.assert_allclose(other.bulk_modulus[-1], path.bulk_modulus[-1], rtol=1e-9)


def path_through(points):
    """A path with these points (γ, z, dz/dγ), each predicted from those before it."""
    network = lattice("square", 2, 2)
    state = spring_state(network, np.ones(network.n_edges), network.positions)
    deformation = deformation_of("dilation", 2)
    path = Path(network, deformation, np.ones(1), "newton", 1e-9, "energy", None)
    for strain, z, velocity in points:
        point = PathPoint(strain, state, np.eye(2), z=z, velocity=velocity)
        path.accept(point, path.predictions(strain) if path.points else np.zeros((1, len(z))))
    return path


@pytest.mark.parametrize("strains, degree", [([0.0, 1.0], 3), ([0.0, 0.3, 1.0], 5)])
def test_a_path_is_extrapolated_to_the_order_of_its_points(strains, degree):
    """Hermite polynomials of two and three points with velocities are exact up to the third and the fifth power."""

    def z(t):
        return np.array([t**degree, 1 - 2 * t**degree])

    def velocity(t):
        return degree * np.array([t ** (degree - 1), -2 * t ** (degree - 1)])

    path = path_through([(t, z(t), velocity(t)) for t in strains])
    np.testing.assert_allclose(path.predictions(1.7)[-1], z(1.7) - z(1.0), rtol=1e-11)
    # Far beyond the last step a straight line errs least.
    np.testing.assert_allclose(path.predictions(9.0)[0], 8.0 * velocity(1.0))


def test_a_path_with_a_kink_is_extrapolated_from_two_points():
    points = [(t, np.array([abs(t - 1.5)]), np.sign([t - 1.5])) for t in (1.0, 2.0, 3.0, 4.0)]
    path = path_through([(0.0, np.zeros(1), np.ones(1)), *points])
    # Two points after the kink lie on a line; three points across it do not.
    np.testing.assert_allclose(path.predictions(5.0)[path.better], [1.0])
