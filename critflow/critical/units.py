"""Natural units of a network: absolute tolerances hold in them, and so results do not depend on the units of the user.

    length          s = (V/N_v)^(1/d)      `Network.spacing`, lengths of edges, s² areas of faces
    stiffness       ⟨k⟩
    modulus         ⟨k⟩ s^(2 − d)          B_0, G_0, C_B, components of the tensor
    stress S/√D     √⟨k⟩ s                 components S_xx, S_xy, ...
    stress σ        Σσ² = N_b              its scale changes no configuration
    V_L, V_τ        1

A quantity names its unit by `Quantity.unit`; a descent minimises ±O over that unit, a target has an error relative to
its size, and at least to a hundredth of its unit.  A state of springs has the units of its energy in place of these,
`SpringState.stiffness_scale` and `length_scale`: the mean stiffness as stretched, and the mean length at rest.
"""

from __future__ import annotations

import numpy as np

from critflow.networks.network import Network


def modulus_unit(network: Network) -> float:
    """⟨k⟩ (V/N_v)^((2 − d)/d)."""
    d = network.dimension
    return float(network.stiffness.mean()) * (1.0 if d == 2 else network.spacing ** (2 - d))


def stress_unit(network: Network) -> float:
    """√⟨k⟩ (V/N_v)^(1/d), of S/√D."""
    return float(np.sqrt(network.stiffness.mean())) * network.spacing
