"""Random valid networks through every public function of the scene, and properties of every network.

No error bound lies below the error against the exact answer, and another description of the same network gives the
same answer.
"""

from __future__ import annotations

import inspect
from pathlib import Path

import fuzzing
import numpy as np
import pytest
import random_problems
from fuzzing import (
    a_deformation,
    answers_or_explains,
    critical_of,
    fuzzed,
    geometry,
    measured,
    optimise,
    randoms,
    relaxed,
    slack_of,
    springs,
    strain_of,
)
from hypothesis import assume, given
from random_problems import a_problem, numbers

import critflow
from critflow import CritflowError, CriticalManifold, PowerLaw, WormLike
from critflow.isogonal import face_modes
from critflow.quantities import flat_directions, stress_hessian, transition_modulus
from critflow.self_stress import Spectrum, edge_without_length
from critflow.taut_part import backbone
from workflows.benchmarks import reference

OBJECTIVES = ("length_variance", "tension_variance", "bulk_modulus", "shear_modulus")

CALLS = {
    "solve": lambda p, r: CriticalManifold(p.network).solve(p.sigma),
    "solve signed": lambda p, r: CriticalManifold(p.network).solve(
        p.sigma * r.choice([1, -1]) * np.sign(numbers(r, len(p.sigma)))
    ),
    "response": lambda p, r: CriticalManifold(p.network).response(critical_of(p)),
    "errors at the transition": lambda p, r: critflow.elasticity(critical_of(p)).value.errors.bulk,
    "upper_bound": lambda p, r: critflow.upper_bound(p.network, "B_0"),
    "upper_bound of a strain": lambda p, r: critflow.upper_bound(
        p.network, transition_modulus(p.network, strain_of(p, r))
    ),
    "stiffening": lambda p, r: critflow.stiffening(critical_of(p)),
    "strain_path": lambda p, r: critflow.strain_path(critical_of(p), [1e-6, 1e-3], measure=measured(p)),
    "strain_path of a law": lambda p, r: critflow.strain_path(
        critical_of(p), [1e-3], measure=measured(p), law=r.choice([PowerLaw(3.0), WormLike(0.5)])
    ),
    "from lengths, conic": lambda p, r: critflow.critical_from_lengths(
        p.network, p.scale * (1.0 + 0.5 * abs(numbers(r, len(p.sigma))))
    ),
    "from its lengths": lambda p, r: critflow.critical_from_lengths(p.network, geometry(p)[2]),
    **{f"optimize {name}": optimise(name) for name in OBJECTIVES},
    "optimize bulk any": optimise("bulk_modulus", signs="any"),
    "optimize shear any": optimise("shear_modulus", signs="any"),
    "optimize from start": lambda p, r: critflow.optimize(
        p.network, r.choice(OBJECTIVES), r.choice(["lbfgs", "newton", "fire", "auto"]), start=p.sigma, max_steps=60
    ),
    "stress_hessian": lambda p, r: stress_hessian(critical_of(p), r.choice(["bulk_modulus", "length_variance"])),
    "flat_directions": lambda p, r: flat_directions(critical_of(p)),
    "isogonal_modes": lambda p, r: critflow.isogonal_modes(critical_of(p)),
    "face_modes": lambda p, r: face_modes(critical_of(p)),
    "spring_state": springs,
    "equilibrium": lambda p, r: critflow.equilibrium(springs(p, r)),
    "equilibrium compressed": lambda p, r: critflow.equilibrium(springs(p, r, -1e-3)),
    "equilibrium fire": lambda p, r: critflow.equilibrium(springs(p, r), "fire", max_steps=200),
    "backbone": lambda p, r: backbone(critical_of(p)),
    "backbone of slack": lambda p, r: backbone(slack_of(p, r)),
    "elasticity at the transition": lambda p, r: critflow.elasticity(critical_of(p)),
    "elasticity of slack": lambda p, r: critflow.elasticity(slack_of(p, r)),
    "elasticity under stress": lambda p, r: critflow.elasticity(relaxed(p, r).value),
    "stiffening of slack": lambda p, r: critflow.stiffening(slack_of(p, r)),
    "strain_path of a deformation": lambda p, r: critflow.strain_path(
        critical_of(p), [1e-4, 1e-3], deformation=a_deformation(p, r), measure=measured(p)
    ),
    "quantity": lambda p, r: critflow.quantity(p.network, "V_L"),
}

# Public functions that these do not reach; each has tests of its own.
ELSEWHERE = {
    *("delaunay_network", "lattice", "three_bar_linkage", "voronoi_network"),
    *("read_critical", "read_network", "to_graph", "to_tables", "write_network"),
}

test_a_public_function_answers_or_explains = answers_or_explains(CALLS)


def test_every_public_function_of_the_scene_is_called():
    source = Path(__file__).read_text(encoding="utf-8") + inspect.getsource(fuzzing)
    scene = {name for name in critflow.__all__ if inspect.isfunction(getattr(critflow, name))}
    assert {name for name in scene if f"critflow.{name}(" not in source} == ELSEWHERE


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
    solution = CriticalManifold(network).solve(sigma)
    critical, found = solution.value, {"status": solution.status}
    if not solution.ok:
        return found
    unit, k = critical.lengths.mean(), network.stiffness.mean()
    found["lengths"] = critical.lengths / unit
    if not edge_without_length(critical.lengths):
        spectrum = Spectrum(network, critical.coordinates)
        if not spectrum.doubt(*spectrum.gap):
            found["counts"] = (spectrum.n_self_stresses, spectrum.n_motions)
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
