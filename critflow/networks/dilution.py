"""Networks of lower coordination: edges removed at random, and what no longer carries tension with them."""

from __future__ import annotations

import numpy as np

from critflow.networks.network import Network
from critflow.networks.pruning import CarryingPart, carrying_part, part_of
from critflow.result import InputError


def diluted(network: Network, z: float, seed: int | np.random.Generator = 0) -> Network:
    """The network with edges removed in random order and then pruned, to the mean coordination z = 2 N_b/N_v.

    z is that of the pruned network, to 1/N_v; its `note` counts the edges removed at random and those that carry no
    tension without them.  The same seed gives the same network, always.  Raises `InputError` for a z above that of the
    network, or so low that no part spans the cell in every direction.
    """
    rng = np.random.default_rng(seed)
    order = rng.permutation(network.n_edges)
    tried: dict[int, CarryingPart] = {}

    def after(n_removed: int) -> CarryingPart:
        if n_removed not in tried:
            left = np.sort(order[n_removed:])
            part = carrying_part(network.edges[left], network.offsets[left], network.pins, network.n_vertices)
            tried[n_removed] = part._replace(edges=left[part.edges])
        return tried[n_removed]

    def above(n_removed: int) -> bool:
        """Whether the coordination is still above z, in a part that spans the cell."""
        return spans(n_removed) and after(n_removed).coordination >= z

    def spans(n_removed: int) -> bool:
        part = after(n_removed)
        return part.directions == network.dimension or (bool(network.pins) and len(part.edges) > 0)

    most = after(0).coordination
    if not 0 < z <= most + 1 / network.n_vertices:
        raise InputError(f"z must be positive and at most the coordination of the network, {most:.6g}, not {z}")
    low, high = 0, network.n_edges
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if above(middle) else (low, middle)
    best = min((n for n in (low, high) if spans(n)), key=lambda n: abs(after(n).coordination - z))
    part = after(best)
    if not spans(high) and abs(part.coordination - z) > 1 / part.n_vertices:
        raise InputError(
            f"z = {z:g} is out of reach: with this seed the network spans the cell to z = {part.coordination:.4g}; "
            "raise z, or try another seed or a larger network"
        )
    note = f"z = {part.coordination:.6g} without {best} of {network.n_edges} edges chosen at random; {part.sentence}"
    return part_of(network, part.edges, note).network
