"""The certificate of a critical configuration as text, with its moduli at the transition."""

from __future__ import annotations

from critflow.elastic import elasticity
from critflow.manifold import CriticalConfiguration
from critflow.quantity_names import upper_bound
from critflow.result import CritflowError, Status
from critflow.self_stress import certify


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
