"""Networks of lower coordination: edges removed at random, and with them all that carry no tension without them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from critflow.arguments import generator, of_kind
from critflow.calls import running
from critflow.networks import Network
from critflow.result import InputError
from critflow_extras.pruning.pruning import CarryingPart, carrying_part, part_of


@running("diluted")
def diluted(network: Network, z: float, seed: int | np.random.Generator = 0) -> Network:
    """The network with edges removed in random order and then pruned, to the mean coordination z = 2 N_b/N_v.

    z is that of the pruned network, to 1/N_v; its `note` counts the edges removed at random and those that carry no
    tension without them.  The same seed gives the same network, always.  Raises `InputError` for a z above that of the
    network, or so low that no part spans the cell in every direction.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> ce.diluted(cf.lattice("triangular", 6, 6), z=4.0, seed=0).n_edges
    72
    """
    network = of_kind(Network, network=network)
    of_kind(float, z=z)
    seed = of_kind(int, np.random.Generator, seed=seed)
    order = generator(seed).permutation(network.n_edges)

    def after(n_removed: int) -> CarryingPart:
        left = np.sort(order[n_removed:])
        edges, offsets = network.edges[left], network.offsets[left]
        part = carrying_part(edges, offsets, network.pins, network.n_vertices, network.cell)
        return part._replace(edges=left[part.edges])

    found = with_coordination(after, network.n_edges, z, 0 if network.pins else network.dimension)
    part, chosen = found.part, f"{found.n_removed} of {network.n_edges} edges chosen at random"
    return part_of(network, part.edges, f"z = {part.coordination:.6g} without {chosen}; {part.sentence}").network


class Found(NamedTuple):
    """The part that can carry tension when a number of objects is removed."""

    part: CarryingPart
    n_removed: int


# Numbers of objects tried on either side when z jumps over its value, as it does where a piece is cut off.
_NEIGHBOURS = 20


def with_coordination(after: Callable[[int], CarryingPart], n_objects: int, z: float, least_directions: int) -> Found:
    """The part with the coordination z, to one over its vertices, when objects are removed one by one.

    after             part that can carry tension after the removal of the first n objects
    least_directions  independent directions in which it must wind around the cell
    """

    def spans(found: Found) -> bool:
        return len(found.part.edges) > 0 and found.part.directions >= least_directions

    def error(found: Found) -> float:
        """Difference from z in units of 1/N_v, less rounding."""
        return abs(found.part.coordination - z) * found.part.n_vertices - 1e-9 if spans(found) else np.inf

    low, high = Found(after(0), 0), Found(after(n_objects), n_objects)
    most = low.part.coordination
    if not (spans(low) and 0 < z and (z <= most or error(low) <= 1)):
        raise InputError(f"z must be positive and at most the coordination of the whole network, {most:.4g}, not {z}")
    best, turn = low, 0
    while error(best) > 1 and high.n_removed - low.n_removed > 1:
        turn, width, share = turn + 1, high.n_removed - low.n_removed, 0.5
        # Where both ends span, z is nearly linear in the number removed; every third step halves the range.
        if spans(high) and turn % 3:
            share = (low.part.coordination - z) / (low.part.coordination - high.part.coordination)
        middle = low.n_removed + min(max(round(share * width), 1), width - 1)
        found = Found(after(middle), middle)
        low, high = (found, high) if spans(found) and found.part.coordination >= z else (low, found)
        best = min(low, high, key=error)
    if error(best) > 1 and not spans(high):
        raise InputError(
            f"z = {z:g} is out of reach: with this seed the last part that spans the cell has "
            f"z = {low.part.coordination:.4g}; try a larger z, another seed or a larger network"
        )
    for away in range(1, _NEIGHBOURS):
        if error(best) <= 1:
            break
        near = [n for n in (low.n_removed - away, high.n_removed + away) if 0 <= n <= n_objects]
        best = min([best, *(Found(after(n), n) for n in near)], key=error)
    return best
