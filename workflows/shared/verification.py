"""The loop of every `verify`: the cases whose stored numbers contradict the stored arrays."""

from __future__ import annotations

from itertools import product

import numpy as np

from critflow import Status


def contradictions(ds, axes, checks):
    """A line for each case with failed checks; `checks(one)` yields pairs of a name and whether it is satisfied."""
    problems = []
    for values in product(*(ds[axis].values for axis in axes)):
        one = ds.sel(dict(zip(axes, values, strict=True)))
        if int(one.status) not in (Status.failed, Status.missing):
            wrong = [name for name, satisfied in checks(one) if not satisfied]
            if wrong:
                case = ", ".join(f"{axis} {value}" for axis, value in zip(axes, values, strict=True))
                problems.append(f"{case}: {', '.join(wrong)} does not follow from the arrays")
    return problems


def forces(one, bond_vectors):
    """Force on every vertex, (N_v, d), from the stored edges and stresses."""
    force = np.zeros(one.coordinates.shape)
    pull = one.sigma.values[:, None] * bond_vectors
    np.add.at(force, one.edges.values[:, 1], pull)
    np.add.at(force, one.edges.values[:, 0], -pull)
    return force


def bond_vectors(one):
    """Bond vectors L (N_b, d) from the stored coordinates, edges, offsets and cell."""
    tail, head = one.edges.values.T
    x = one.coordinates.values
    return x[head] - x[tail] + one.offsets.values @ one.cell.values


def variances(one, lengths, tensions):
    """Checks of the stored variances V_L and V_τ."""
    for name, values in (("length_variance", lengths), ("tension_variance", tensions)):
        yield name, np.isclose(np.var(values) / np.mean(values) ** 2, one[name], rtol=1e-8, atol=1e-20)
