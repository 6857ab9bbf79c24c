"""The loop of every `verify`: the cases whose stored numbers contradict the stored arrays."""

from itertools import product

import numpy as np

from critflow import Status
from critflow.checks import components

EPS = np.finfo(float).eps
BALANCED = 1e-11  # force left by sums of terms, over the mean tension


def contradictions(ds, axes, checks):
    """A line for each case with failed checks; `checks(one)` yields pairs of a name and whether it is satisfied.

    The cases of one value of the first of the axes are read at once.
    """
    problems = []
    for first in ds[axes[0]].values:
        block = ds.sel({axes[0]: first}).load()
        for others in product(*(ds[axis].values for axis in axes[1:])):
            one = block.sel(dict(zip(axes[1:], others, strict=True)))
            if int(one.status) not in (Status.failed, Status.missing):
                wrong = [name for name, satisfied in checks(one) if not satisfied]
                if wrong:
                    case = ", ".join(f"{axis} {value}" for axis, value in zip(axes, (first, *others), strict=True))
                    problems.append(f"{case}: {', '.join(wrong)} does not follow from the arrays")
    return problems


def forces(one, bond_vectors):
    """Force on every vertex, (N_v, d), from the stored edges and stresses."""
    force = np.zeros(one.position.shape)
    pull = one.sigma.values[:, None] * bond_vectors
    np.add.at(force, one.edges.values[:, 1], pull)
    np.add.at(force, one.edges.values[:, 0], -pull)
    return force


def balance_error(one, tension):
    """Largest force (a number) that rounding leaves on a vertex in balance, for tensions (N_b,) of the edges.

    Bond vectors are differences of stored positions, which have the rounding of the size of the cell: an edge of
    large σ is short, and its rounding is pulled by σ all the same.
    """
    size = np.abs(one.position.values).max() + np.abs(one.offsets.values @ one.cell.values).max()
    pull = np.bincount(one.edges.values.ravel(), np.repeat(np.abs(one.sigma.values), 2)).max()
    return BALANCED * np.abs(tension).mean() + 2 * EPS * size * pull


def bond_vectors(one):
    """Bond vectors L (N_b, d) from the stored positions, edges, offsets and cell."""
    tail, head = one.edges.values.T
    x = one.position.values.astype(float)
    return x[head] - x[tail] + one.offsets.values @ one.cell.values


def configuration(one):
    """Checks of a stored configuration: force balance, lengths, moduli at the transition, variances."""
    L, sigma, cell = bond_vectors(one), one.sigma.values, one.cell.values
    length, volume = np.linalg.norm(L, axis=1), abs(np.linalg.det(cell))
    tension = sigma * length
    # Moduli add up over the connected parts of the stressed edges.
    edges, stressed = one.edges.values, sigma != 0
    part = components(edges[stressed], int(edges.max()) + 1)[edges[stressed, 0]]
    part = np.unique(part, return_inverse=True)[1]
    cost, square, across = (
        np.bincount(part, values[stressed])
        for values in (volume * tension**2 / one.stiffness.values, sigma * length**2, sigma * L[:, 0] * L[:, 1])
    )
    yield "force balance", np.abs(forces(one, L)).max() <= balance_error(one, tension)
    yield "length", np.allclose(length, one.length, rtol=1e-10, atol=1e-13)
    bulk = np.sum(square**2 / cost) / len(cell) ** 2
    yield "B_0", np.isclose(bulk, one.B_0, rtol=1e-9)
    shear = np.sum(across**2 / cost)
    yield "G_0", np.isclose(shear, one.G_0, rtol=1e-6, atol=1e-14)
    yield from variances(one, length, tension)


def variances(one, lengths, tensions):
    """Checks of the stored variances V_L and V_τ."""
    for name, values in (("V_L", lengths), ("V_tau", tensions)):
        yield name, np.isclose(np.var(values) / np.mean(values) ** 2, one[name], rtol=1e-8, atol=1e-20)
