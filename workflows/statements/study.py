"""Statements of the paper on small networks: counts, the map from stress to configuration, moduli, optima.

Each statement is measured in every network by dense matrices or by few solves, in less than a second: a number, and
whether the statement holds in this network.  The statements themselves are in `workflows/paper/statements.toml`.
"""

import numpy as np

import critflow as cf
from critflow.engine import Coordinate, Variable
from critflow.engine.study import nearest, plural
from critflow.result import StudyError

from ..paper.statements import Measurement, statement
from ..paper.verdicts import claims_of, committed_run
from ..shared.checks import voronoi_check
from ..shared.reports import finite
from ..shared.tables import network_study, numbers
from . import counting, optima, parameterization, response
from .sample import Sample

# Every statement of this study: its measure, and what the number is.
MEASURES = {
    "codimension-one": (counting.codimension_one, "normals"),
    "counting": (counting.counting, "error of the count"),
    "generic-no-self-stress": (counting.generic_no_self_stress, "self-stresses"),
    "generic-floppy": (counting.generic_floppy, "change of a length"),
    "second-order-rigid": (counting.second_order_rigid, "least stiffness of P on zero modes over its mean"),
    "prestress-stability": (counting.prestress_stability, "rigid ones of six stresses"),
    "driven-to-critical": (counting.driven_to_critical, "self-stresses"),
    "three-bar-floppy": (counting.three_bar_floppy, "least over largest singular value of R"),
    "tensions-do-not-fix": (parameterization.tensions_do_not_fix, "difference of tensions and lengths"),
    "prestress-matrix": (parameterization.prestress_matrix, "second eigenvalue over the mean stress"),
    "unique-configuration": (parameterization.unique_configuration, "force, change of a length"),
    "overconstrained": (parameterization.overconstrained, "change of a length"),
    "stiffness-rule": (parameterization.stiffness_rule, "force"),
    "hessian-split": (parameterization.hessian_split, "difference over the largest entry"),
    "vertex-model-coupling": (parameterization.vertex_model_coupling, "exceptions among the pairs"),
    "soft-modes": (response.soft_modes, "ratio of deviations at strains ten times apart"),
    "same-zero-modes": (parameterization.same_zero_modes, "difference"),
    "boundary-term": (parameterization.boundary_term, "difference"),
    "stress-is-normal": (parameterization.stress_is_normal, "component along the manifold"),
    "derivative": (parameterization.derivative, "difference over the largest entry"),
    "bond-operator": (response.bond_operator, "difference over the largest change"),
    "one-self-stress": (counting.one_self_stress, "self-stresses"),
    "moduli-jump": (response.moduli_jump, "bulk modulus at max B_0, in units of k"),
    "modulus-formula": (response.modulus_formula, "difference, in units of k"),
    "energy-of-distance": (response.energy_of_distance, "relative difference"),
    "B_0-one-force-network": (optima.B_0_one_force_network, "difference of tensions"),
    "isogonal-face-modes": (optima.isogonal_face_modes, "modes that faces do not span"),
    "B_0-lengths": (optima.B_0_lengths, "mean length"),
    "unique-V_L": (optima.unique_V_L, "difference of σ"),
    "random-addition": (optima.random_addition, "stressed part of the edges on random points"),
    "dense-later": (optima.dense_later, "vertices near slack edges over those near taut ones"),
    "equal-lengths-any-spring": (response.equal_lengths_any_spring, "least over largest tension"),
    "angles-of-120": (optima.angles_of_120, "least V_τ"),
    "stiffened": (response.stiffened, "ratio of moduli"),
    "robust": (response.robust, "change of the bulk modulus"),
    "two-groups": (response.two_groups, "ratio of eigenvalues across the gap"),
}
# Statements on the linkage alone: configurations for each seed.
OF_THREE_BARS = {"three-bar-floppy": counting.N_LINKAGES, "tensions-do-not-fix": 2 * parameterization.N_LINKAGES}


def case(parameters, *, seed):
    """The number and the answer of every statement in one network."""
    sample = Sample(parameters["n_vertices"], seed)
    answers = [MEASURES[name][0](sample) for name in parameters["statements"]]
    return {
        "status": cf.Status.ok,
        "number": np.array([float(number) for number, _ in answers]),
        "satisfied": np.array([bool(satisfied) for _, satisfied in answers], np.int8),
    }


def check(parameters, axes):
    voronoi_check()(parameters, axes)
    for name in parameters["statements"]:
        if name not in MEASURES:
            raise StudyError(f"{name!r} is not measured here: {nearest(name, list(MEASURES), 'statements')}")


def claims(ds):
    """One claim a statement: the part of the networks in which it holds."""
    return claims_of(map(_measurement, [ds.sel(statement=name) for name in ds.statement.values]))


def _measurement(one):
    name, known = str(one.statement.values), finite(one.number)
    satisfied = one.satisfied.values[one.status.values == cf.Status.ok]
    low, high = (f"{value:.2g}" for value in (known.min(), known.max())) if len(known) else ("", "")
    span = low if low == high else f"{low} to {high}"
    text = f"in {int(np.sum(satisfied == 1))} of {len(satisfied)}; {MEASURES[name][1]}: {span}"
    value = float(np.mean(satisfied == 1)) if len(satisfied) else float("nan")
    n = OF_THREE_BARS[name] * len(satisfied) if name in OF_THREE_BARS else 0
    sample = f"{n:,} configurations of three bars" if n else plural(len(satisfied), "network")
    return Measurement(statement(name).id, value, text, sample)


study = network_study(
    name="statements",
    title="Statements of the paper that small networks decide",
    committed=committed_run("statements"),
    parameters={"n_vertices": 60, "statements": tuple(MEASURES)},
    coordinates=(Coordinate("statement", "statements", "statement of the paper"),),
    case=case,
    check=check,
    variables=(
        *numbers(("seed", "statement"), number="measured number of each statement, described in its claim"),
        Variable("satisfied", ("seed", "statement"), "i1", long_name="whether the statement holds in this network"),
    ),
    claims=claims,
)
