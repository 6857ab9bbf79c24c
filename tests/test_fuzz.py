"""Random valid networks through every public function: properties of every network.

Nothing but a `CritflowError` is raised, no warning is given, no number of an `ok` answer is NaN, no error bound lies
below the error against the exact answer, no call exceeds its number of factorisations, and another description of the
same network gives the same answer.
"""

from __future__ import annotations

import dataclasses
import inspect
import warnings
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
import random_problems
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from public import checked_functions
from random_problems import a_problem, numbers
from scipy.sparse.linalg import LinearOperator

import critflow
from critflow import CritflowError, CriticalManifold, Hookean, Network, PowerLaw, Solution, WormLike
from critflow.critical.transition import transition_modulus
from critflow.extras.fronts.leverage import EdgeLeverage
from critflow.extras.tissue.tissue import FaceSprings
from critflow.extras.weak.weak_energies import AngleSprings
from critflow.linalg.factor import FixedPattern
from workflows.benchmarks import reference

# Factorisations of one call on at most eight vertices; the largest number seen is a third of it.
BUDGET = 3000
# Draws of Hypothesis are near their simplest value, of which no network with a bound results.
randoms = st.randoms(use_true_random=True)
# The networks are made by draws, many of which are refused.
fuzzed = settings(suppress_health_check=list(HealthCheck), max_examples=max(settings.default.max_examples // 2, 1))


def critical_of(problem):
    return CriticalManifold(problem.network).solve(problem.sigma).or_raise("fuzz").value


def geometry(problem):
    """Network, coordinates and lengths of the critical configuration."""
    critical = critical_of(problem)
    return problem.network, critical.coordinates, critical.lengths


def springs(problem, random, strain=1e-3):
    """Springs of the critical lengths, a little out of balance."""
    network, x, lengths = geometry(problem)
    moved = x + 1e-3 * float(lengths.min()) * numbers(random, *x.shape)
    law = random.choice([Hookean(), PowerLaw(1.5 + random.randint(0, 3)), WormLike(0.5)])
    return critflow.spring_state(network.deformed((1 + strain) * np.eye(network.dimension)), lengths, moved, law)


def weakened(problem):
    found = call.weak_forces(critical_of(problem), AngleSprings())
    found.value.modulus([-1e-3, 0.0, 1e-3], 1e-4)  # NaN beyond the end of the branch
    return found


def relaxed(problem, random):
    return critflow.equilibrium(springs(problem, random))


def strain_of(problem, random):
    return numbers(random, problem.network.dimension, problem.network.dimension)


def measured(problem):
    """What a path measures: no moduli without a cell."""
    return "energy" if problem.network.cell is None else "tensors"


def a_deformation(problem, random):
    return random.choice(["dilation", "simple_shear", "pure_shear", "uniaxial", strain_of(problem, random)])


def loose(problem, random):
    """Rest lengths a little above those of the critical configuration."""
    return geometry(problem)[2] * (1.05 + 0.05 * numbers(random, len(problem.sigma)))


def surface_points(surface):
    """The strains of the rays that meet the surface, and nothing of the others, which have a status."""
    return surface.strains[surface.found], surface.normals[surface.found], surface.error_bounds[surface.found]


def slack_of(problem, random):
    """A critical configuration with edges that carry nothing, if it is one."""
    lengths = geometry(problem)[2] * (1.0 + 0.5 * abs(numbers(random, len(problem.sigma))))
    return critflow.critical_from_lengths(problem.network, lengths, throw=False).value


def tissue_of(problem):
    """Faces at a critical configuration, with the perimeters as those at rest."""
    network, x, lengths = geometry(problem)
    faces = FaceSprings.of(network, 1.0, None)
    return critflow.tissue(network, np.asarray(faces.sides @ lengths), x)


def optimise(objective, **options):
    return lambda p, r: critflow.optimize(p.network, objective, max_steps=60, **options)


OBJECTIVES = ("length_variance", "tension_variance", "bulk_modulus", "shear_modulus")

# One or more calls of every public function that takes or makes a network.
call = SimpleNamespace(**checked_functions())

CALLS = {
    "solve": lambda p, r: CriticalManifold(p.network).solve(p.sigma),
    "solve signed": lambda p, r: CriticalManifold(p.network).solve(
        p.sigma * r.choice([1, -1]) * np.sign(numbers(r, len(p.sigma)))
    ),
    "response": lambda p, r: CriticalManifold(p.network).response(critical_of(p)),
    "errors at the transition": lambda p, r: call.elasticity(critical_of(p)).value.errors.bulk,
    "upper_bound": lambda p, r: call.upper_bound(p.network, "B_0"),
    "least C_B": lambda p, r: call.quantity(p.network, "C_B").extreme(CriticalManifold(p.network))[0],
    "upper_bound of a strain": lambda p, r: call.upper_bound(p.network, transition_modulus(p.network, strain_of(p, r))),
    "certify": lambda p, r: call.certify(critical_of(p)),
    "rigidity": lambda p, r: call.rigidity(*geometry(p)[:2]),
    "zero_modes": lambda p, r: call.zero_modes(*geometry(p)[:2]),
    "second_order_rigidity": lambda p, r: call.second_order_rigidity(*geometry(p)[:2]),
    "self_stresses": lambda p, r: call.self_stresses(critical_of(p)),
    "stability": lambda p, r: call.stability(critical_of(p)),
    "signed_stress": lambda p, r: call.signed_stress(*geometry(p)[:2], np.sign(p.sigma).astype(int)),
    "signed_stress any": lambda p, r: call.signed_stress(*geometry(p)[:2], [r.choice([-1, 0, 1]) for _ in p.sigma]),
    "stiffening": lambda p, r: call.stiffening(critical_of(p)),
    "strain_path": lambda p, r: call.strain_path(critical_of(p), [1e-6, 1e-3], measure=measured(p)),
    "strain_path of a law": lambda p, r: call.strain_path(
        critical_of(p), [1e-3], measure=measured(p), law=r.choice([PowerLaw(3.0), WormLike(0.5)])
    ),
    "from lengths, conic": lambda p, r: call.critical_from_lengths(
        p.network, p.scale * (1.0 + 0.5 * abs(numbers(r, len(p.sigma))))
    ),
    "from its lengths": lambda p, r: call.critical_from_lengths(p.network, geometry(p)[2]),
    **{f"optimize {name}": optimise(name) for name in OBJECTIVES},
    "optimize bulk any": optimise("bulk_modulus", signs="any"),
    "optimize shear any": optimise("shear_modulus", signs="any"),
    "optimize from start": lambda p, r: call.optimize(
        p.network, r.choice(OBJECTIVES), r.choice(["lbfgs", "newton", "fire", "auto"]), start=p.sigma, max_steps=60
    ),
    "stress_hessian": lambda p, r: call.stress_hessian(critical_of(p), r.choice(["bulk_modulus", "length_variance"])),
    "flat_directions": lambda p, r: call.flat_directions(critical_of(p)),
    "isogonal_modes": lambda p, r: call.isogonal_modes(critical_of(p)),
    "face_modes": lambda p, r: call.face_modes(critical_of(p)),
    "design faces": lambda p, r: call.design(
        critical_of(p), {"length[0]": abs(float(numbers(r, 1)[0]))}, change="faces", max_steps=20
    ),
    "elasticity of a tissue": lambda p, r: call.elasticity(tissue_of(p)),
    "critical_from_perimeters": lambda p, r: call.critical_from_perimeters(
        p.network, 3.7 * np.ones(len(FaceSprings.of(p.network, 1.0, None).stiffness))
    ),
    "spring_state": springs,
    "equilibrium": lambda p, r: call.equilibrium(springs(p, r)),
    "equilibrium compressed": lambda p, r: call.equilibrium(springs(p, r, -1e-3)),
    "equilibrium fire": lambda p, r: call.equilibrium(springs(p, r), "fire", max_steps=200),
    "elasticity of rest lengths": lambda p, r: call.elasticity(
        p.network.deformed(1.001 * np.eye(p.network.dimension)), relaxed(p, r).value.coordinates, geometry(p)[2]
    ),
    "bond_operator": lambda p, r: call.bond_operator(relaxed(p, r).value),
    "geometric_split": lambda p, r: call.geometric_split(relaxed(p, r).value),
    "hookean_split": lambda p, r: call.hookean_split(relaxed(p, r).value),
    "backbone": lambda p, r: call.backbone(critical_of(p)),
    "backbone of slack": lambda p, r: call.backbone(slack_of(p, r)),
    "elasticity at the transition": lambda p, r: call.elasticity(critical_of(p)),
    "elasticity of slack": lambda p, r: call.elasticity(slack_of(p, r)),
    "elasticity at rest": lambda p, r: call.elasticity(*geometry(p)[:2]),
    "elasticity under stress": lambda p, r: call.elasticity(relaxed(p, r).value),
    "stiffening of slack": lambda p, r: call.stiffening(slack_of(p, r)),
    "strain_path of a deformation": lambda p, r: call.strain_path(
        critical_of(p), [1e-4, 1e-3], deformation=a_deformation(p, r), measure=measured(p)
    ),
    "critical_strain": lambda p, r: call.critical_strain(p.network, loose(p, r), a_deformation(p, r)),
    "rigidity_surface": lambda p, r: surface_points(
        call.rigidity_surface(p.network, loose(p, r), [np.eye(p.network.dimension)])
    ),
    "nearest_critical": lambda p, r: call.nearest_critical(
        p.network, geometry(p)[1] * (1 + 0.01 * numbers(r, *geometry(p)[1].shape)), max_steps=30
    ),
    "examine": lambda p, r: call.examine(*geometry(p)[:2]),
    "design stiffness": lambda p, r: call.design(
        call.spring_state(p.network, geometry(p)[2], geometry(p)[1]),
        {"B_0": 0.5 + r.random(), "G_0": 0.5 + r.random()},
        change="stiffness",
        max_steps=60,
    ),
    "design stress": lambda p, r: call.design(p.network, {"V_L": 0.2 * r.random()}, max_steps=20),
    "pareto": lambda p, r: call.pareto(p.network, {"V_tau": "smallest", "V_L": "smallest"}, 3, max_steps=40),
    "weak_forces": lambda p, r: weakened(p),
    "weak_equilibrium": lambda p, r: call.weak_equilibrium(critical_of(p), AngleSprings(), [1e-3], 1e-4, throw=False),
    "soft_spectrum": lambda p, r: call.soft_spectrum(critical_of(p)),
    "edge_leverage": lambda p, r: call.edge_leverage(critical_of(p)),
    "properties": lambda p, r: call.properties(critical_of(p), r.choice([["V_tau", "V_L"], ["B_0", "C_B"]])),
    "quantity": lambda p, r: call.quantity(p.network, "V_L"),
    "prune_towards": lambda p, r: call.prune_towards(critical_of(p), {"V_tau": "smallest"}, cuts=2),
    "pruned": lambda p, r: call.pruned(p.network, numbers(r, len(p.sigma)) < 0.5),
}

# Public functions that these do not reach, and where they are tested.
ELSEWHERE = {
    *(
        "lattice",
        "three_bar_linkage",
        "voronoi_network",
        "delaunay_network",
        "foam_network",
        "fibre_network",
        "diluted",
    ),
    *("packing_network", "regular_network", "random_sequential_addition"),
    *("network_from", "write_network", "draw", "deformation_of"),  # one test each
    *("isotropic_targets", "transition_modulus"),  # tests/design, tests/quantities
    *("planar_faces", "strain_plane", "write_page"),  # numbers only
}


# What every answer must satisfy

# Fields that are NaN where a quantity is unknown or does not apply, by the documentation.
MAY_BE_NAN = set(
    """
    error_bound condition residual bond_errors ratio uncertainty nearest_singular least_stiffness gap
    smallest_nonzero largest_zero objective_error bound error stress_error undetermined cuts weights after
    amplification
    """.split()
)


def nan_fields(value, name="value", seen=()):
    """Names of numbers that are NaN in an answer, except those that may be."""
    if name in MAY_BE_NAN or id(value) in seen or "modulus" in name:
        return []
    if isinstance(value, Solution) and not value.ok:
        return []
    if isinstance(value, EdgeLeverage):
        return [] if (np.isnan(value.errors) == np.isnan(value.after)).all() else [name]
    seen = (*seen, id(value))
    if isinstance(value, LinearOperator):
        return nan_fields(value.matmat(np.eye(value.shape[1])), name)
    if isinstance(value, float | np.ndarray | np.floating):
        array = np.asarray(value)
        return [name] if array.dtype.kind == "f" and np.isnan(array).any() else []
    if dataclasses.is_dataclass(value) and not isinstance(value, Network):
        return [found for f in dataclasses.fields(value) for found in nan_fields(getattr(value, f.name), f.name, seen)]
    if isinstance(value, tuple | list):
        return [found for part in value for found in nan_fields(part, name, seen)]
    return []


def complaint(result) -> str:
    """What is wrong with an answer, or nothing."""
    found = nan_fields(result)
    return f"NaN in {sorted(set(found))}" if found else ""


class BudgetExceeded(BaseException):
    """Not an error that a call could catch."""


@contextmanager
def budget(most):
    """Stop a call after a number of factorisations."""
    factorize, count = FixedPattern.factorize, 0

    def counted(*arguments, **options):
        nonlocal count
        count += 1
        if count > most:
            raise BudgetExceeded(f"more than {most} factorisations")
        return factorize(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FixedPattern, "factorize", counted)
        yield


def test_every_public_function_is_called():
    source = inspect.getsource(inspect.getmodule(test_every_public_function_is_called))
    public = set(checked_functions())
    called = {name for name in public if f"call.{name}(" in source or f"critflow.{name}(" in source}
    assert public - called == ELSEWHERE


@pytest.mark.parametrize("name", CALLS)
@fuzzed
@given(random=randoms)
def test_a_public_function_answers_or_explains(name, random):
    problem = a_problem(random)
    assume(problem is not None)
    with budget(BUDGET), warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            result = CALLS[name](problem, random)
        except CritflowError as error:
            assert 10 < len(str(error)) < 400 and "\n" not in str(error)
            return
    assert complaint(result) == ""


# Error bounds


def assert_bounded(values, truth, bound):
    assert reference.largest_error(values, truth) <= bound


@fuzzed
@given(random=randoms)
def test_error_bounds_exceed_the_errors(random):
    problem = a_problem(random)
    assume(problem is not None and problem.network.n_vertices <= 6)
    network = problem.network
    solution = CriticalManifold(network).solve(problem.sigma)
    assume(solution.ok)
    exact = reference.configuration(network, problem.sigma, digits=reference.digits_for(problem.sigma))
    critical = solution.value
    assert_bounded(critical.coordinates, exact.coordinates, critical.error_bound)
    for L, truth, bound in zip(critical.bond_vectors, exact.bond_vectors, critical.bond_errors, strict=True):
        assert reference.largest(reference.roots([((reference.numbers(L) - truth) ** 2).sum()])) <= bound
    if network.cell is None or network.dimension != 2:
        return
    try:
        found = critflow.elasticity(critical)
    except CritflowError:
        return
    # The reference is the formula of one self-stress.
    if found.stats.method != "transition":
        return
    moduli = found.value
    B_0, G_0 = reference.transition_moduli(network, exact)
    assert_bounded([moduli.bulk], [B_0], moduli.errors.bulk)
    assert_bounded([moduli.shear], [G_0], moduli.errors.shear)


# Invariance


def facts(network, sigma):
    """Numbers that do not depend on the description, in units of the largest cell vector or pin distance and mean k."""
    manifold = CriticalManifold(network)
    solution = manifold.solve(sigma)
    critical, found = solution.value, {"status": solution.status}
    if not solution.ok:
        return found
    unit, k = critical.lengths.mean(), network.stiffness.mean()
    found["lengths"] = critical.lengths / unit
    counts = critflow.rigidity(network, critical.coordinates)
    if counts.ok:
        found["counts"] = (counts.value.n_self_stresses, counts.value.n_zero_modes)
    if network.cell is not None:
        found["bulk bound"] = critflow.upper_bound(network, "B_0") / (k * unit**2 / network.volume)
        try:
            found["B_0"] = critflow.elasticity(critical).value.bulk / (k * unit**2 / network.volume)
            found["C_B"] = critflow.stiffening(critical).value.C_B / (k * unit**2 / network.volume)
        except CritflowError as error:
            found["error"] = type(error)
    return found


def assert_same(one, other, order=slice(None)):
    shared = one.keys() & other.keys() - {"status", "counts", "error"}
    assert one["status"] == other["status"]
    # Counts next to the tolerance have a status; where both are certain they agree.
    assert one.get("counts", ()) == other.get("counts", ()) or "counts" not in one.keys() & other.keys()
    assert one.get("error") == other.get("error")
    for name in shared:
        expected = one[name][order] if name == "lengths" else one[name]
        np.testing.assert_allclose(other[name], expected, rtol=1e-6, atol=1e-9, err_msg=name)


CHANGES = {
    "scale": lambda r, n: (n.deformed(10.0 ** r.randint(-12, 12) * np.eye(n.dimension)), slice(None)),
    "rotation": lambda r, n: (n.deformed(random_problems.rotation(r, n.dimension)), slice(None)),
    "translation": lambda r, n: (random_problems.translated(r, n), slice(None)),
    "labels": random_problems.relabelled,
    "cell vectors": lambda r, n: (random_problems.with_other_cell_vectors(r, n), slice(None)),
    "stiffness": lambda r, n: (n.with_stiffness(n.stiffness * 10.0 ** r.randint(-9, 9)), slice(None)),
}


@pytest.mark.parametrize("change", CHANGES)
@fuzzed
@given(random=randoms)
def test_another_description_gives_the_same_answer(change, random):
    problem = a_problem(random)
    assume(problem is not None and np.ptp(np.log10(problem.sigma)) < 4)
    network = problem.network
    assume(change != "cell vectors" or network.cell is not None)
    changed, order = CHANGES[change](random, network)
    assert_same(facts(network, problem.sigma), facts(changed, problem.sigma[order]), order)
