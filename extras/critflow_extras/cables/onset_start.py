"""Cables at an onset of rigidity, where strain paths start: taut ones at rest, slack ones below their rest lengths.

Paths and coefficients of an onset are along its deformation, unless another one is named.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from critflow.deformation import Deformation
from critflow.growth import StiffeningSolution, exact_stiffening
from critflow.manifold import COLLAPSED, CriticalConfiguration, CriticalManifold
from critflow.networks import Array
from critflow.paths import Beginning, start_of
from critflow.result import InputError
from critflow.springs import Cable, SpringLaw, SpringState, checked_law
from critflow.taut_part import backbone
from critflow_extras.cables.onset_end import CriticalStrain
from critflow_extras.cables.total_strain import total_strains

CONSISTENT_LENGTHS = 1e-6  # relative deviation of taut edges from their rest lengths; solutions have 1e-9
OPENING = 1e-3  # displacements of floppy vertices that give collapsed slack edges a direction, in units of ⟨ℓ⟩


@start_of.register
def _(onset: CriticalStrain, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """The configuration at the onset, from which strains count."""
    springs, stress, note, _ = start_of(onset.configuration, law, taut_only)
    counted = f"strains count from the onset at strain {onset.strain:.6g}: total_strains are those of the network given"
    along = onset.deformation, partial(total_strains, onset)
    return springs, stress, f"{note}; {counted}" if note else counted, along


@exact_stiffening.register
def _(
    onset: CriticalStrain, path: Deformation | None, law: SpringLaw, manifold: CriticalManifold | None
) -> StiffeningSolution:
    """The coefficients of the configuration at the onset, by default along the deformation of the onset."""
    path = onset.deformation if path is None else path
    found: StiffeningSolution = exact_stiffening(onset.configuration, path, law, manifold)
    return found


def cables_at_onset(critical: CriticalConfiguration, rest: Array, law: SpringLaw | None) -> Beginning:
    """All edges of an onset as cables of rest lengths ℓ (N_b,)."""
    taut, law = critical.sigma != 0, Cable() if law is None else law
    if not (law.one_sided or taut.all()):
        raise InputError(
            "slack springs would be compressed at this configuration: choose law=Cable(), or taut_only=True, or relax "
            "a spring_state with equilibrium() and start from it"
        )
    if not np.abs(critical.lengths[taut] / rest[taut] - 1).max() <= CONSISTENT_LENGTHS:
        raise InputError("the taut edges do not have these rest lengths: give those of which the configuration is made")
    if not (critical.lengths > COLLAPSED * critical.lengths.mean()).all():
        critical = _opened(critical, float(rest.mean()))
    rest = np.where(taut, critical.lengths, rest)
    law = checked_law(law, rest, critical.network.stiffness)
    springs = SpringState(critical.network, rest, critical.coordinates, critical.bond_vectors, law)
    return springs, critical.sigma, "", None


def _opened(critical: CriticalConfiguration, length: float) -> CriticalConfiguration:
    """The configuration with its floppy vertices displaced a little, so that every slack edge has a direction."""
    network, floppy = critical.network, backbone(critical).floppy_vertices
    x = critical.coordinates.copy()
    x[floppy] += OPENING * length * np.random.default_rng(0).standard_normal((len(floppy), network.dimension))
    x = x if network.pins else x - x[0]
    L = np.where((critical.sigma != 0)[:, None], critical.bond_vectors, network.bond_vectors(x))
    lengths = np.linalg.norm(L, axis=1)
    if not (lengths > COLLAPSED * lengths.mean()).all():
        raise InputError(
            f"the slack edge {int(lengths.argmin())} joins two vertices of the taut part at one place, so it has no "
            "direction: vary the rest lengths a little, or follow the taut part with taut_only=True"
        )
    return replace(critical, coordinates=x, bond_vectors=L)
