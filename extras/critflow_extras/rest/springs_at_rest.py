"""Elasticity of networks at coordinates, and of states of springs, that are at rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.deformation import strain_basis
from critflow.elastic import elastic_response, total_response
from critflow.linear_response import Elasticity, LinearResponse
from critflow.networks import Network, validated_coordinates
from critflow.result import InputError, Stats, Status
from critflow.springs import SpringLaw, SpringState, edge_directions, spring_state
from critflow.taut_edges import without_hanging
from critflow.taut_part import taut_networks
from critflow_extras.pruning.pruning import taut_mask
from critflow_extras.rest.at_rest import Springs, errors_of, response_at_rest

# Change of a tensor by a stress that counts as rounding, relative to the affine tensor and to the largest σ over the
# largest k: 0.6 was found in random networks just past the transition.
NEGLECTED = 5.0

_SLACK = "all cables are slack or hang on one taut edge, so nothing resists: shorten their rest lengths"


def response_of_network(
    network: Network,
    volume: float,
    *,
    coordinates: ArrayLike | None,
    rest_lengths: ArrayLike | None,
    taut: ArrayLike | None,
    law: SpringLaw,
    **options: Any,
) -> LinearResponse:
    """The response of springs at coordinates, at rest if they have no other rest lengths."""
    rest = rest_lengths
    if coordinates is None:
        raise InputError("the elasticity of a network depends on its configuration: give coordinates")
    if taut is not None and not taut_mask(network, taut).all():
        if rest is not None:
            raise InputError("taut edges are those of springs at rest: for rest lengths choose law=Cable()")
        return _of_taut(network, coordinates, taut, volume)
    if rest is None:
        rest = np.linalg.norm(edge_directions(network, coordinates)[1], axis=1)
    state = spring_state(network, rest, coordinates, law)
    response: LinearResponse = elastic_response(state, volume, **options)
    return response


def _of_taut(network: Network, coordinates: ArrayLike, taut: ArrayLike, volume: float) -> LinearResponse:
    """The response of all connected parts of the taut edges at rest."""
    x, mask = validated_coordinates(network, coordinates), taut_mask(network, taut)
    parts = taut_networks(network, mask)
    total = total_response([response_at_rest(part, x[vertices], volume) for part, _, vertices in parts])
    slack = f"{np.count_nonzero(~mask)} of {network.n_edges} edges are slack: the moduli are those of the taut part"
    return replace(total, note=f"{total.note}; {slack}" if total.note else slack)


def state_at_rest(
    state: SpringState, volume: float, tolerance: float, perimeters: Callable[[Springs], Springs] | None = None
) -> LinearResponse:
    """The response of springs whose stress is rounding; its effect is part of the errors.

    tolerance   part of the mean rest length by which a cable at rest may be shorter; shorter ones are slack
    perimeters  as of `response_at_rest`
    """
    network, x = state.network, state.coordinates
    taut = np.ones(network.n_edges, bool)
    if state.law.one_sided:
        taut = without_hanging(network, state.extension >= -tolerance * state.length_scale)
    if not taut.any():
        zero, d = np.zeros((len(strain_basis(network.dimension)[0]),) * 2), network.dimension
        value = Elasticity(zero, zero, np.zeros((d, d)), volume, errors_of(zero, d), 0.0)
        return LinearResponse(value, Status.floppy, Stats("self-stress"), _SLACK, n_self_stresses=0)
    response = response_at_rest(network, x, volume, perimeters) if taut.all() else _of_taut(network, x, taut, volume)
    value, largest = response.value, float(np.abs(state.sigma).max())
    if not largest:
        return response
    stress = largest / np.abs(state.edge_stiffness).max()
    errors = value.errors.tensor + NEGLECTED * stress * np.abs(value.affine).max()
    return replace(response, value=replace(value, errors=errors_of(errors, state.network.dimension)))
