"""Tables of variables by their dimensions, and the arrays of a case from the numbers of its parts."""

import numpy as np

from critflow import Status
from critflow.engine import Axis, Coordinate, Study, Variable

from .reports import PAPER

# Symbols of variables in TeX, which datasets hold for the axes of figures.
SYMBOLS = {
    **{name: f"${name}$" for name in ("B_0", "G_0", "C_B", "C_G", "V_L", "B", "G")},
    "V_tau": "$V_\\tau$",
    "kappa_phys": "$\\langle\\kappa_{phys}\\rangle$",
    "kappa_force": "$\\langle\\kappa_{force}\\rangle$",
    "C_G_stress_corrected": "$C_G$, stress-corrected",
    "G_stress_corrected": "$G$, stress-corrected",
}


def networks(n):
    """The axis of n generated networks."""
    return Axis("seed", range(n), "seed of the network", noun="network")


def numbers(dims, dtype="f8", /, **long_names):
    """Variables of one type with the same dimensions, by name and meaning."""
    return [
        Variable(name, dims, dtype, long_name=text, symbol=SYMBOLS.get(name, "")) for name, text in long_names.items()
    ]


def bounded(dims, /, **long_names):
    """Variables with the same dimensions, each followed by the bound on its error, `NAME_error_bound`."""
    return [
        one
        for name, text in long_names.items()
        for one in numbers(dims, **{name: text, f"{name}_error_bound": f"bound on the error of {name}"})
    ]


def outcomes(dims, /, **long_names):
    """Variables with codes of `Status`."""
    return [Variable(name, dims, "i1", long_name=text, flags=Status) for name, text in long_names.items()]


def network_study(*, variables, n=10, references=PAPER, **more):
    """A study whose cases are n generated networks, each with the status of the whole case as its last variable."""
    status = outcomes(("seed",), status="outcome of the case")
    return Study(axes=(networks(n),), references=references, variables=(*variables, *status), **more)


# The network of each seed.
NETWORK = (
    *numbers(("seed", "edge", "end"), "i4", edges="vertices at tail and head of each edge"),
    *numbers(("seed", "edge", "axis"), "i2", offsets="cell image in which the head of each edge lies"),
    *numbers(("seed", "cell_vector", "axis"), cell="cell vectors as rows"),
    *numbers(("seed", "edge"), stiffness="stiffness k of each edge; 1 but for a network of a file"),
)

# Labels of its inner dimensions, in the plane and in space.
PLANE, SPACE = (
    (
        Coordinate("end", "", "end of an edge", words=("tail", "head")),
        Coordinate("axis", "", "component of a vector", words=("x", "y", "z")[:d]),
        Coordinate("cell_vector", "", "vector of the periodic cell", words=("a", "b", "c")[:d]),
    )
    for d in (2, 3)
)


def of_network(network):
    """The arrays of `NETWORK`."""
    names = ("edges", "offsets", "cell", "stiffness")
    return {name: getattr(network, name) for name in names}


def stacked(rows):
    """One dict of arrays from dicts with the same names."""
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def padded(values, n, fill=np.nan):
    """The values along the first dimension, followed by `fill` up to n of them."""
    values = np.asarray(values)
    result = np.full((n, *values.shape[1:]), fill)
    result[: len(values)] = values
    return result
