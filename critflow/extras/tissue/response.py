"""Elasticity of tissues at the transition: springs on perimeters in place of those on edges."""

from __future__ import annotations

from critflow.extensions import provided
from critflow.extras.tissue.face_springs import FaceSprings
from critflow.extras.tissue.tissue import CriticalTissue
from critflow.response.at_transition import strain_rates, tensor_of_self_stress
from critflow.response.elasticity import AT_REST, ElasticResponse, Options, elastic_response, of_one_self_stress
from critflow.response.tensor import Elasticity

SLACK_FACE = 1e-9  # tension of a face without any, relative to the largest


@elastic_response.register(CriticalTissue)
def _at_transition(tissue: CriticalTissue, volume: float, _: Options) -> ElasticResponse:
    """The response of the perimeters in tension, at rest where these have several self-stresses."""
    critical, tense = tissue.configuration, tissue.face_tensions > SLACK_FACE * tissue.face_tensions.max()
    faces = FaceSprings(tissue.faces.sides[tense], tissue.faces.stiffness[tense])
    if not faces.several_self_stresses(critical.network, critical.bond_vectors):
        return of_one_self_stress(_of_self_stress(tissue, volume), critical.residual)
    response: ElasticResponse = provided("response_at_rest", AT_REST)(
        critical.network, critical.coordinates, volume, faces.of_edges
    )
    return response


def _of_self_stress(tissue: CriticalTissue, volume: float) -> Elasticity:
    """V C_ab = (T·ṗ_a)(T·ṗ_b)/Σ T²/κ of the tensions T and the rates ṗ_a of the perimeters; errors are unknown."""
    configuration, faces = tissue.configuration, tissue.faces
    rates = (strain_rates(configuration.bond_vectors) / configuration.lengths) @ faces.sides.T
    return tensor_of_self_stress(tissue.face_tensions, rates, 1 / faces.stiffness, tissue.network.dimension, volume)
