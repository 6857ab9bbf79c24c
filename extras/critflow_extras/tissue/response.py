"""Elasticity and stiffening of tissues at the transition: springs on perimeters in place of those on edges."""

from __future__ import annotations

from typing import Any

import numpy as np

from critflow.deformation import Deformation
from critflow.elastic import elastic_response, strain_rates, tensor_of_self_stress, under_stress
from critflow.growth import StiffeningSolution, coefficients, exact_stiffening, failed, strains_of_growth, with_status
from critflow.linear_response import Elasticity, Errors, LinearResponse, linear_response
from critflow.manifold import CriticalManifold
from critflow.numerics import EPS
from critflow.result import InputError, Stats, Status
from critflow.springs import HOOKEAN, SpringLaw
from critflow_extras.rest.at_rest import response_at_rest
from critflow_extras.rest.springs_at_rest import state_at_rest
from critflow_extras.tissue.face_springs import FaceSprings
from critflow_extras.tissue.state import TissueState
from critflow_extras.tissue.tissue import CriticalTissue
from critflow_extras.tissue.tissue_energy import PerimeterSystem, TissueEnergy, balanced_system

SLACK_FACE = 1e-9  # tension of a face without any, relative to the largest
# Unbalanced force of a critical tissue over its mean tension, from which exact balance is a small correction.
BALANCED_TISSUE = 1e-8
# Errors of a tissue are the largest change in two samples of perturbed bond vectors, times ten.
_SAMPLES, _SAMPLE_MARGIN = 2, 10.0


@elastic_response.register(CriticalTissue)
def _at_transition(tissue: CriticalTissue, volume: float, **_: Any) -> LinearResponse:
    """The response of the perimeters in tension, at rest where these have several self-stresses."""
    critical, tense = tissue.configuration, tissue.face_tensions > SLACK_FACE * tissue.face_tensions.max()
    faces = FaceSprings(tissue.faces.sides[tense], tissue.faces.stiffness[tense])
    if not faces.several_self_stresses(critical.network, critical.bond_vectors):
        stats = Stats("transition", residual=critical.residual)
        return LinearResponse(_of_self_stress(tissue, volume), Status.ok, stats, n_self_stresses=1)
    response: LinearResponse = response_at_rest(critical.network, critical.coordinates, volume, faces.of_edges)
    return response


@elastic_response.register(TissueState)
def _of_state(state: TissueState, volume: float, *, tolerance: float, **_: Any) -> LinearResponse:
    """The response of perimeters under stress, or of those at rest."""
    if under_stress(state, tolerance):
        return linear_response(state, volume)
    response: LinearResponse = state_at_rest(state, volume, tolerance, state.faces.of_edges)
    return response


def _of_self_stress(tissue: CriticalTissue, volume: float) -> Elasticity:
    """V C_ab = (T·ṗ_a)(T·ṗ_b)/Σ T²/κ of the tensions T and the rates ṗ_a of the perimeters; errors are unknown."""
    configuration, faces = tissue.configuration, tissue.faces
    rates = (strain_rates(configuration.bond_vectors) / configuration.lengths) @ faces.sides.T
    errors = Errors(np.full((len(rates) - 1,) * 2, np.nan), np.nan, np.nan, np.nan)
    return tensor_of_self_stress(
        tissue.face_tensions, rates, 1 / faces.stiffness, tissue.network.dimension, volume, errors
    )


@exact_stiffening.register(CriticalTissue)
def _stiffening(
    tissue: CriticalTissue, path: Deformation | None, law: SpringLaw, _manifold: CriticalManifold | None
) -> StiffeningSolution:
    """The coefficients, whose errors are ten times the largest change in two samples of perturbed bond vectors."""
    path = Deformation.dilation(tissue.network.dimension) if path is None else path
    if law != HOOKEAN:
        raise InputError("springs on perimeters are Hookean: leave out law=")
    if path.free:
        return failed(Status.floppy, "free components of the cell relax the tensions of a tissue: fix the cell")
    if not ((tissue.face_tensions > 0).all() and tissue.configuration.residual < BALANCED_TISSUE):
        raise InputError("faces without tension and edges without length leave no response: change the perimeters")
    system, errors = balanced_system(tissue)
    if tissue.faces.several_self_stresses(tissue.network, system.bond_vectors):
        raise InputError(
            "this requires one self-stress and the perimeters have several: follow strain_path() and fit its moduli"
        )
    if system.soft:
        return failed(Status.unstable, "the tensions of the faces do not stabilise all zero modes")
    V, strains, rng = tissue.network.volume, strains_of_growth(path), np.random.default_rng(0)
    energy = TissueEnergy(system, strains)
    exact, _, condition = coefficients(energy, V, path)
    samples = []
    for _ in range(_SAMPLES):
        noise = (errors * rng.standard_normal(errors.shape))[:, None]
        other = PerimeterSystem(tissue, system.tensions, system.bond_vectors * (1 + noise))
        samples.append(np.abs(coefficients(TissueEnergy(other, strains), V, path)[0] - exact))
    error = _SAMPLE_MARGIN * (np.max(samples, axis=0) + EPS * np.abs(exact))
    error += path.error(exact, lambda other: coefficients(TissueEnergy(system, strains_of_growth(other)), V, other)[0])
    return with_status(energy, exact, error, condition)
