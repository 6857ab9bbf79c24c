"""Optima in other units of stiffness and length: the same steps and stresses, with values in these units."""

from functools import partial

import numpy as np
from problems import NETWORKS, foam_network, hung_ring
from units import Units, same_in_units

from critflow import CriticalManifold, Network, optimize, voronoi_network
from critflow.descent import Descent
from critflow.optima import largest_modulus, objective_of
from critflow.quantities import pure_shear
from workflows.shear.compression import least_compressed_length


def optimum(network, units, name, method="auto", **options):
    found = optimize(network, name, method, throw=False, **options)
    ends = (found.status, found.note, found.stats.steps, found.stats.residual, found.gap, found.saddles)
    return {
        "number": (*ends, found.value.sigma, found.collapsed_edges, found.slack_edges, found.nearest_singular),
        "one" if name[0] == "V" else "stiffness": (
            found.objective,
            found.objective_error,
            found.uncertainty,
            found.bound,
            *found.starts,
        ),
    }


def equal_lengths(network, units, **options):
    found = optimize(network, "V_L", throw=False, **options)
    return {"number": (found.status, found.stats.method, found.stats.steps, found.value.sigma)}


def in_space(network, units, name):
    return {"pressure": (optimize(network, name).objective,)}


def closed_form(network, units):
    found = largest_modulus(network, pure_shear(2))
    bulk, shear = (optimize(network, name, signs="any") for name in ("B_0", "modulus[uniaxial]"))
    by_methods = bulk.objective, shear.objective, bulk.objective_error
    return {
        "number": (found.status, found.value.sigma, found.gap),
        "length": (found.value.coordinates,),
        "stiffness": (found.objective, found.bound, *by_methods),
    }


def objective(network, units, name):
    objective = Descent(CriticalManifold(network), objective_of(network, name, 0.1))
    x = np.random.default_rng(1).standard_normal(network.n_edges)
    point = objective.at(x)
    return {"number": (point.value, point.gradient, point.residual, objective.hessian_product(point, np.cos(x)))}


def compressed(network, units):
    return {"length": (least_compressed_length(network, pure_shear(2)),)}


FOAM = partial(foam_network, 60, seed=1)
NETWORK, SMALL = NETWORKS["voronoi, random stiffness"], NETWORKS["tiny"]
COLLAPSING = partial(voronoi_network, 40, seed=47, hard_core=0.65)
OPTIMA = {
    **{
        f"{name} by {method}": {"name": name, "method": method}
        for name in ("V_tau", "G_0")
        for method in ("lbfgs", "newton")
    },
    **{name: {"name": name} for name in ("G_0", "V_tau", "B_0")},
    "of FIRE": {"name": "V_tau", "method": "fire"},
    "threshold": {"name": "G_0", "threshold": 0.2},
    "signed": {"name": "G_0", "signs": "any", "method": "lbfgs", "max_steps": 100},
}
test_optima_in_other_units = same_in_units(
    {name: (partial(optimum, **options), SMALL) for name, options in OPTIMA.items()}
    | {"collapse": (partial(optimum, name="V_tau"), COLLAPSING), "ring": (partial(optimum, name="V_tau"), hung_ring)}
    | {"equal lengths": (equal_lengths, partial(voronoi_network, 12, seed=0))}
    | {f"objective {name}": (partial(objective, name=name), NETWORK) for name in ("G_0", "V_tau", "V_L", "B_0")},
)
test_closed_forms_in_other_units = same_in_units(
    {"closed form": (closed_form, NETWORK), "conic": (equal_lengths, NETWORK)}
    | {"rough": (partial(equal_lengths, tolerance=1e-4), partial(voronoi_network, 300, seed=1))}
    | {"G_0 in space": (partial(in_space, name="G_0"), FOAM)},
    rtol=1e-9,
)


test_programs_in_other_units = same_in_units({"compressed": (compressed, NETWORK)}, 1e-9)


def with_edges_that_stay_slack():
    network, pairs = voronoi_network(40, seed=1), np.random.default_rng(1).integers(0, 40, (9, 2))
    edges = np.concatenate([network.edges, pairs[pairs[:, 0] != pairs[:, 1]]])
    offsets = np.zeros_like(edges)
    offsets[: network.n_edges] = network.offsets
    return Network(edges, offsets, network.cell, n_vertices=40)


def conic(network, units):
    found = optimize(network, "V_L", "conic", throw=False)
    return {"number": (found.status, found.slack_edges, found.value.sigma)}


FAR = [Units(length=2.0**-40), Units(length=2.0**-30), Units(length=2.0**40)]
test_the_cone_program_in_units_of_any_size = same_in_units({"slack": (conic, with_edges_that_stay_slack)}, 1e-9, FAR)
