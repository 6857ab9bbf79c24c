"""The certificate of a critical configuration: balance, counts and rigidity, as a record and as text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.elastic import elasticity
from critflow.manifold import CriticalConfiguration
from critflow.quantities import upper_bound
from critflow.result import CritflowError, Record, Status
from critflow.saddles import Saddle
from critflow.taut_part import backbone
from critflow_extras.certificates.counts import Rigidity, rigidity

# Unbalanced forces below this, relative to the mean tension, are those of a self-stress: configurations from σ leave
# 1e-15, coordinates of eight digits 1e-8.
BALANCED = 1e-8


@dataclass(frozen=True, repr=False)
class Certificate(Record):
    """Quantities that show that a configuration is critical, and their accuracy.

    Where edges are slack, σ = 0, all but the residual describe the taut part.

    residual           largest unbalanced force relative to the mean tension
    least_tension      smallest tension relative to the mean
    n_self_stresses    expected 1
    gap                the singular values on both sides of the count
    rigid              whether that stress stabilises the zero modes
    stressed_fraction  fraction of the edges that are stressed
    n_slack            slack edges
    n_unstressed_vertices  vertices that only slack edges meet
    """

    residual: float
    least_tension: float
    n_self_stresses: int
    n_zero_modes: int
    gap: tuple[float, float]
    rigid: bool
    stressed_fraction: float = 1.0
    n_slack: int = 0
    n_unstressed_vertices: int = 0


@running("certify")
def certify(critical: CriticalConfiguration) -> Certificate:
    """Check a critical configuration from its coordinates and stresses alone; of slack ones the taut part.

    Raises `InputError` for stresses that are not finite or zero everywhere.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> certificate = ce.certify(cf.optimize(network, 'B_0'))
    >>> certificate.n_self_stresses, certificate.rigid
    (1, True)
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    bone = backbone(critical)
    tensions = critical.tensions[bone.taut]
    found = [_certified(component, critical.residual) for component in bone.components]
    counts = [count for count, _ in found]
    return Certificate(
        critical.residual,
        float(tensions.min() / np.abs(tensions).mean()),
        sum(count.n_self_stresses for count in counts),
        sum(count.n_zero_modes for count in counts),
        (max(count.largest_zero for count in counts), min(count.smallest_nonzero for count in counts)),
        all(rigid for _, rigid in found),
        bone.stressed_fraction,
        bone.n_slack,
        len(bone.floppy_vertices),
    )


def _certified(critical: CriticalConfiguration, residual: float) -> tuple[Rigidity, bool]:
    """The counts of a configuration without slack edges, and whether it is rigid."""
    counted = rigidity(critical.network, critical.coordinates)
    counts = counted.value
    sigma, balanced = critical.sigma, residual < BALANCED
    if balanced and (sigma > 0).all():
        # P(σ) of a connected network is then positive definite, however small some stresses are.
        return counts, True
    # With several self-stresses, σ itself may stabilise all zero modes.
    by_sigma = counts.n_self_stresses > 1 and balanced
    rigid = counts.rigid or (by_sigma and Saddle(critical.network).stable(sigma, critical.bond_vectors))
    return counts, rigid and counted.status is not Status.singular


def certificate_text(critical: CriticalConfiguration, title: str, outcome: Status) -> str:
    """The certificate, one line per check; moduli where they are defined."""
    certificate, network = certify(critical), critical.network
    low, high = certificate.gap
    state = "rigid to second order" if certificate.rigid else "not shown to be rigid: floppy parts remain"
    lines = {
        "status": outcome.name,
        "force-balance residual": f"{certificate.residual:.2g} of the mean tension",
        "least tension": f"{certificate.least_tension:.3g} of the mean",
        "self-stresses": f"{certificate.n_self_stresses} (singular values {low:.1e} | {high:.1e})",
        "zero modes": f"{certificate.n_zero_modes}; {state}",
    }
    try:
        moduli, bound = elasticity(critical).value, upper_bound(network, "B_0")
        lines["B_0"] = f"{moduli.bulk:.10f}, {100 * moduli.bulk / bound:.6f} % of its bound {bound:.10f}"
        lines["G_0"] = f"{moduli.shear:.10g}"
    except CritflowError as error:
        lines["moduli"] = str(error)
    width = max(map(len, lines))
    head = f"{title}: {network.n_vertices} vertices, {network.n_edges} edges"
    return "\n".join([head, *(f"  {name:<{width}}  {text}" for name, text in lines.items())])
