"""No more model than a question needs: which matrices are factorised, told by their size, and what is not run at all.

Three patterns have sizes of their own: P of the configurations (n_free), the elastic Hessian (d n_free), and systems of
stresses and displacements together (d n_free + N_b).
"""

import sys
from collections import Counter

import numpy as np
import pytest

from critflow import (
    CriticalManifold,
    Status,
    bulk_modulus_bound,
    certify,
    critical_from_lengths,
    foam_network,
    optimize,
    spring_state,
    stiffening,
    strain_path,
    transition_moduli,
    voronoi_network,
)
from critflow.critical.objectives import OBJECTIVES, pure_shear
from critflow.design.modulus_bounds import largest_modulus, modulus_bound
from critflow.linalg.factor import FixedPattern
from critflow.mechanics.moduli import linear_response
from critflow.workflow.dataset import labelled_dataset
from critflow.workflow.folder import Folder
from critflow.workflow.load import load_study
from critflow.workflow.plan import select
from critflow.workflow.store import read_shard
from critflow.workflow.tasks import Job, run_cases

NETWORKS = {"planar": voronoi_network(60, seed=1), "foam": foam_network(60, seed=1)}
SPRINGS, STRAIN = "Hessian", [0.001, 0.002, 0.003]
# The package calls functions by the names of these modules.
OPTIMIZE, PATH = sys.modules["critflow.design.optimize"], sys.modules["critflow.mechanics.strain_path"]


@pytest.fixture(params=NETWORKS)
def network(request):
    return NETWORKS[request.param]


@pytest.fixture
def manifold(network):
    return CriticalManifold(network)


@pytest.fixture
def critical(manifold):
    """A random stress, and nothing special about its configuration."""
    return manifold.configuration(np.abs(np.random.default_rng(0).standard_normal(manifold.network.n_edges)))


@pytest.fixture
def factorised(monkeypatch):
    """`factorised(network, question)` counts the factorisations behind an answer by what the matrix is."""
    sizes = []
    factorize = FixedPattern.factorize

    def counting(self, *arguments, **options):
        sizes.append(self.size)
        return factorize(self, *arguments, **options)

    monkeypatch.setattr(FixedPattern, "factorize", counting)

    def count(network, question):
        sizes.clear()
        question()
        n, d = len(network.free), network.dimension
        names = {n: "P", d * n: SPRINGS, d * n + network.n_edges: "saddle"}
        return Counter(names.get(size, "part") for size in sizes)

    return count


def forbidden(*arguments, **options):
    raise AssertionError("nobody asked for this")


def test_the_counter_sees_what_springs_need(factorised, network, critical):
    """Against tests that find nothing because they count nothing."""
    path = strain_path(network, critical, STRAIN).value
    assert factorised(network, lambda: linear_response(path.states[0])) == {SPRINGS: 1}
    assert factorised(network, lambda: strain_path(network, critical, STRAIN))[SPRINGS] >= len(STRAIN)


def test_a_configuration_is_one_factorisation(factorised, network, manifold):
    sigma = np.arange(1.0, 1.0 + network.n_edges)
    assert factorised(network, lambda: manifold.configuration(sigma)) == {"P": 1}


def test_moduli_at_the_transition_factorise_nothing(factorised, network, critical):
    assert factorised(network, lambda: transition_moduli(critical)) == {}


def test_a_closed_form_is_never_iterated(factorised, monkeypatch, network, manifold):
    """Not one step of any method, and the configuration at σ = k is all that is solved for."""
    monkeypatch.setattr(OPTIMIZE, "descend", forbidden)
    answers = []
    counts = factorised(network, lambda: answers.append(optimize(manifold, "bulk_modulus")))
    assert set(counts) == {"P"} and counts["P"] <= 2  # P(k) for bound and configuration, and for the residual
    assert answers[0].stats.steps == 0 and answers[0].stats.method == "closed_form"
    assert factorised(network, lambda: bulk_modulus_bound(manifold)) == {"P": 1}


def test_the_largest_shear_modulus_takes_one_system_more(factorised):
    network = NETWORKS["planar"]
    manifold = CriticalManifold(network)
    assert factorised(network, lambda: modulus_bound(manifold, pure_shear(2))) == {"P": 1}
    counts = factorised(network, lambda: largest_modulus(manifold, pure_shear(2)))
    # P(k) for the bound and for its forces, P of the stress that was found for its configuration.
    assert counts["saddle"] == 1 and counts["P"] <= 3 and SPRINGS not in counts


@pytest.mark.parametrize("name", OBJECTIVES)
def test_no_optimisation_looks_at_the_springs(factorised, name):
    network = NETWORKS["planar"]
    assert SPRINGS not in factorised(network, lambda: optimize(CriticalManifold(network), name, throw=False))


def test_coefficients_take_one_system_and_no_path(factorised, monkeypatch, network, manifold, critical):
    monkeypatch.setattr(PATH, "relaxed", forbidden)
    answers = []
    counts = factorised(network, lambda: answers.append(stiffening(manifold, critical)))
    # P(σ) brings the coordinates into exact balance.
    assert counts == {"saddle": 1, "P": 1}
    assert answers[0].ok


def test_a_path_without_moduli_measures_nothing(factorised, monkeypatch, network, critical):
    monkeypatch.setattr(PATH, "linear_response", forbidden)
    without = factorised(network, lambda: strain_path(network, critical, STRAIN, moduli=False))
    assert set(without) == {SPRINGS}


def test_lengths_lead_to_the_transition_without_springs(factorised):
    """The cone program, Newton's polish on the stressed edges, and the forces of its end made exact."""
    network = NETWORKS["planar"]
    lengths = 1 + 0.02 * np.sin(1.0 + np.arange(network.n_edges))
    answers = []
    counts = factorised(network, lambda: answers.append(critical_from_lengths(network, lengths)))
    assert answers[0].status is Status.ok
    assert set(counts) == {"P", "saddle"} and counts["P"] <= 2  # at most once for each tolerance of the cone


@pytest.mark.parametrize("n_vertices", [60, 500])
def test_a_certificate_of_tensions_factorises_no_system(factorised, n_vertices):
    """Tension alone shows that the zero modes are stabilised; large networks are counted by inertias of RᵀR."""
    network = voronoi_network(n_vertices, seed=1)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    counts = factorised(network, lambda: certify(critical))
    assert set(counts) <= {SPRINGS} and counts[SPRINGS] <= 4
    assert certify(critical).rigid


def test_the_counter_tells_a_hessian_apart(factorised, network, critical):
    state = spring_state(network, 0.999 * critical.lengths, critical.coordinates)
    assert factorised(network, lambda: state.factorize(state.pattern())) == {SPRINGS: 1}


def stored(name, words, path):
    """The dataset of a run, without its report."""
    loaded = load_study(name)
    selection = select(loaded.study, words)
    folder, parameters = Folder(path), selection.parameters
    for part in (folder.shards, folder.failed):
        part.mkdir(parents=True, exist_ok=True)
    job = Job(str(loaded.path), loaded.digest, str(path), parameters, selection.study.selected, command=(name,))
    run_cases(job, [case.values for case in selection.cases()])
    shards = [(case, read_shard(folder.shards, selection.study, case)) for case in selection.cases()]
    return labelled_dataset(selection, shards, failed=[])


STUDIES = {"ensemble": "n_vertices=60", "three_dimensions": "n_vertices=60"}
LINEAR = ("seeds=1:3", "populations=bulk_modulus,random_stress")


@pytest.fixture(scope="module", params=STUDIES)
def whole(request, tmp_path_factory):
    """A study by name, and the dataset of all that it can compute."""
    name = request.param
    return name, stored(name, [STUDIES[name], *LINEAR], tmp_path_factory.mktemp(name))


ASKED = {
    "C_B alone": ("C_B_exact,bulk_modulus_0", {"P", "saddle"}),
    "closed forms": ("bulk_modulus_0,shear_modulus_0,stressed_fraction,length_variance", {"P"}),
    "the configuration": ("sigma,coordinates,edges,offsets,cell", {"P"}),
    "the path": ("C_B,energy", {"P", SPRINGS}),
    "scalars": ("scalars", {"P", "saddle", SPRINGS}),
}


@pytest.mark.parametrize("asked", ASKED)
def test_a_study_computes_what_it_is_asked_for_with_the_same_bits(whole, factorised, tmp_path, asked):
    name, everything = whole
    variables, matrices = ASKED[asked]
    made = []

    def ask():
        made.append(stored(name, [STUDIES[name], *LINEAR, f"variables={variables}"], tmp_path))

    assert set(factorised(NETWORKS["planar" if name == "ensemble" else "foam"], ask)) == matrices
    few = made[0]
    asked_for = {*variables.split(","), "status"}
    if variables == "scalars":
        asked_for = {v for v in everything if set(everything[v].dims) == {"population", "seed"}}
    assert set(few.data_vars) == asked_for
    assert (few.status == Status.ok).all()
    for variable in few.data_vars:
        assert few[variable].values.tobytes() == everything[variable].values.tobytes(), variable
    assert ("strain" in few.dims) == ("energy" in few)


@pytest.mark.parametrize(
    ("variables", "spared"),
    [
        ("C_B_exact", ("strain_path", "face_anisotropy", "force_anisotropy")),
        ("C_G,newton_steps", ("stiffening", "face_anisotropy", "force_anisotropy")),
        ("coordinates,anisotropy_force", ("strain_path", "stiffening", "face_anisotropy")),
    ],
)
def test_what_is_not_asked_for_is_not_called(monkeypatch, variables, spared):
    study = load_study("ensemble").study
    here = study.case.__globals__
    members = here["measured"].__globals__
    for function in spared:
        monkeypatch.setitem(here if function in here else members, function, forbidden)
    parameters = {**study.parameters, "n_vertices": 20}
    values = {"seed": 1, "population": "random_stress"}
    assert set(study.storing(variables.split(",")).computed(parameters, values)) == {*variables.split(","), "status"}
    with pytest.raises(AssertionError, match="nobody asked"):
        study.computed(parameters, values)
