"""One stored configuration: its picture and the certificate that it is critical, both from the stored arrays alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.design.modulus_bounds import bulk_modulus_bound
from critflow.mechanics.moduli import transition_moduli
from critflow.networks.network import Network
from critflow.plot import network_figure
from critflow.result import InputError, Status
from critflow.rigidity.counts import certify

if TYPE_CHECKING:
    import xarray as xr

_NEEDED = ("edges", "offsets", "cell", "sigma", "coordinates")


def show_configuration(case: xr.Dataset, path: Path) -> str:
    """Draw one case of a dataset to `path` and return its certificate as text.

    Raises `InputError` for a dataset without the arrays of a configuration, or a case that has none.
    """
    missing = [name for name in _NEEDED if name not in case]
    if missing:
        raise InputError(f"this dataset holds no configurations: it lacks {', '.join(missing)}")
    edges, offsets, cell, sigma, coordinates = (case[name].values for name in _NEEDED)
    if not (np.isfinite(sigma).all() and np.isfinite(coordinates).all()):
        raise InputError("this case has no configuration: its status says why; choose another")
    network = Network(edges, offsets, cell)
    critical = CriticalConfiguration(network, sigma, coordinates, network.bond_vectors(coordinates))
    chosen = {name: case[name].item() for name in map(str, case.coords) if case[name].ndim == 0}
    title = ", ".join(f"{name} {value}" for name, value in chosen.items())
    figure = network_figure(edges, offsets, cell, coordinates, sigma, critical.lengths, title)
    figure.savefig(path, dpi=200)
    return f"{certificate_text(critical, title, case)}\ndrawn in {path}"


def certificate_text(critical: CriticalConfiguration, title: str, case: xr.Dataset) -> str:
    """The certificate, a line for each thing that was checked."""
    certificate = certify(critical)
    network, moduli = critical.network, transition_moduli(critical)
    bound = bulk_modulus_bound(network)
    low, high = certificate.gap
    state = "rigid to second order" if certificate.rigid else "not shown to be rigid: floppy parts are left"
    lines = [
        (title, f"{network.n_vertices} vertices, {network.n_edges} edges"),
        ("status", Status(int(case["status"])).name if "status" in case else "not stored"),
        ("force-balance residual", f"{certificate.residual:.2g} of the mean tension"),
        ("least tension", f"{certificate.least_tension:.3g} of the mean"),
        ("self-stresses", f"{certificate.n_self_stresses} (singular values {low:.1e} | {high:.1e})"),
        ("zero modes", f"{certificate.n_zero_modes}; {state}"),
        ("B_0", f"{moduli.bulk:.10f}, {100 * moduli.bulk / bound:.6f} % of its bound {bound:.10f}"),
        ("G_0", f"{moduli.shear:.10g}"),
    ]
    width = max(len(name) for name, _ in lines[1:])
    return "\n".join([f"{lines[0][0]}: {lines[0][1]}", *(f"  {name:<{width}}  {text}" for name, text in lines[1:])])
