"""Stiffening coefficients: growth of the moduli past the transition, from the critical configuration alone.

Along a path F(γ) with A = F'(0) and M = F''(0) (`Deformation`) the moduli of the strained network are, with volume V(γ)
and relaxed energy E, and to first order
    B = V d²E/dV²                     of a dilation b → (1 + δ)^{1/d} F(γ) b,        B = B_0 + C_B γ
    G = (1/V) d²E/dε²                 of the shear b → (1 + ε ½(e_x e_yᵀ + e_y e_xᵀ)) F(γ) b,   G = G_0 + C_G γ
    G − ½ dE/dV  (stress-corrected)
    M = (1/V) d²E/dγ²                 along the path itself,                         M = M_0 + C γ
Those of dilation are the C_B and C_G of `moduli`, with M = B/(1 + γ)² and so C = C_B − 2 B_0.
"""

from __future__ import annotations

from dataclasses import astuple, replace
from functools import partial
from typing import Any

import numpy as np

from critflow.arguments import of_kind, of_known_kind
from critflow.certificates.prestress import stabilises
from critflow.certificates.uniqueness import require_only_self_stress
from critflow.critical.backbone import backbone
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.extensions import extensible
from critflow.networks.deformation import Deformable, Deformation, deformation_of
from critflow.precision.residual import exact_displacement
from critflow.progress import running
from critflow.response.coefficients import Stiffening, StiffeningSolution, coefficients, failed, with_status
from critflow.response.third_order import ThirdOrderEnergy
from critflow.result import InputError, Status
from critflow.springs.laws import HOOKEAN, SpringLaw
from critflow.threads import one_blas_thread


@running("stiffening")
@one_blas_thread()
def stiffening(
    critical: Any,
    throw: bool = True,
    *,
    law: SpringLaw = HOOKEAN,
    deformation: Deformable = "dilation",
    manifold: CriticalManifold | None = None,
) -> StiffeningSolution:
    """Growth of the moduli along a path exactly, from the critical configuration alone: no strain path.

    The module's docstring defines the moduli and coefficients, `coefficients` their sums of derivatives of the energy.
    A law adds Σ E''' e_δ² e_γ/V to the C_B of Hookean springs, and likewise to the others, with the elongations
    e_a = ḣ_a/|L| = c_a σ̂|L|/k; the moduli at the transition are the same for all laws.

    deformation  what `deformation_of` accepts; antisymmetric parts of A rotate the network and change no modulus
                 to first order but G, whose axes do not rotate
    manifold     of the network, with other stiffnesses for instance; that of the configuration by default

    A tissue, of `critical_from_perimeters`, has the same coefficients; their errors are ten times the largest change in
    two samples of bond vectors perturbed by their errors.

    Slack edges, σ = 0, resist nothing; disconnected taut parts add up.  The value is that of the configuration in exact
    balance under the floating-point σ, found from the given coordinates in extended precision.

    Errors (estimate): `stats.error_bound` limits those of the value; errors of first order are exact, roundings are
    summed by `accumulated_rounding`.  `stats.condition` is the largest factor by which relative errors of bond
    vectors are amplified in the coefficients.

    `Status.unstable` and NaN where P(σ̂) is not positive on the zero modes, so that no response exists;
    `Status.undecided` where rounding hides whether it is;
    `Status.ill_conditioned` and NaN where an error exceeds a tenth of the largest coefficient;
    `Status.floppy` and NaN where the strain does no work on the self-stress, or free components of the cell relax it.
    Raises `InputError` for configurations with several self-stresses, and for free components that leave it as it is.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = cf.stiffening(cf.optimize(network, 'B_0')).value
    >>> round(found.C_B / found.bulk_0, 6)  # −1/2 of springs as stiff as their stress
    -0.5
    """
    critical = of_known_kind(exact_stiffening, CriticalConfiguration, critical=critical)
    of_kind(bool, throw=throw)
    of_kind(SpringLaw, law=law)
    manifold = of_kind(CriticalManifold, None, manifold=manifold)
    path = deformation_of(deformation, critical.network.dimension)
    solution: StiffeningSolution = exact_stiffening(critical, path, law, manifold)
    return solution.or_raise("no stiffening coefficients") if throw else solution


@extensible
def exact_stiffening(
    critical: CriticalConfiguration, path: Deformation, law: SpringLaw, manifold: CriticalManifold | None
) -> StiffeningSolution:
    """The coefficients by the kind of springs; those on edges here."""
    if manifold is not None:
        critical.require_same_geometry(manifold.network)
        critical = replace(critical, network=manifold.network)
    if relaxing := _relaxing(critical, path):
        return failed(Status.floppy, relaxing)
    parts = backbone(critical).components
    return _total(
        [_of_part((manifold if part is critical else None) or part.manifold, part, law, path) for part in parts]
    )


def _of_part(
    manifold: CriticalManifold, critical: CriticalConfiguration, law: SpringLaw, path: Deformation
) -> StiffeningSolution:
    """The coefficients of a configuration without slack edges."""
    network = manifold.network
    require_only_self_stress(critical, "follow strain_path() and fit its moduli")
    system = manifold.system(critical.sigma)
    stable = stabilises(network, critical.coordinates, critical.bond_vectors, critical.sigma)
    if not stable:
        undecided = stable is not False
        note = "" if undecided else "the stress does not stabilise all zero modes"
        return failed(Status.undecided if undecided else Status.unstable, note)
    factor = manifold.prestress.factorize_signed(critical.sigma)
    balance = exact_displacement(network, critical.coordinates, lambda _: critical.sigma, factor.solve)
    if not np.isfinite(balance.remainder):
        return failed(Status.ill_conditioned, "rounding hides which configuration balances this stress exactly")

    energy_of = partial(ThirdOrderEnergy, network, critical.sigma, balance.bond_vectors, system, law)
    return with_status(coefficients(energy_of, network.volume, path))


def _relaxing(critical: CriticalConfiguration, path: Deformation) -> str:
    """The reason why free components of the cell leave the network floppy, or an empty string without any."""
    if not path.free:
        return ""
    sigma, L = critical.sigma, critical.bond_vectors
    stress = (sigma[:, None] * L).T @ L
    works = np.abs(np.einsum("mij,ij->m", path.free_strains, stress))
    if works.max() > 1e-9 * np.linalg.norm(stress):
        free = path.free[int(works.argmax())]
        return (
            f"the free component {free} of the cell relaxes the only self-stress, so the network is floppy along this "
            "path at the transition: fix the cell, or follow strain_path() from a rigid state"
        )
    raise InputError(
        "the free components of the cell do not relax the self-stress: fix the cell, or use strain_path() and fit its "
        "moduli"
    )


def _total(parts: list[StiffeningSolution]) -> StiffeningSolution:
    """The sum over taut parts, which are disconnected; the first failure decides the status."""
    for part in parts:
        if not part.ok:
            return part
    if len({part.loosening for part in parts}) > 1:
        return failed(Status.slack_edges, "the strain stretches some taut parts and loosens others: take each part")
    value, error = (
        Stiffening(*map(float, np.sum([astuple(each) for each in numbers], axis=0)))
        for numbers in ([part.value for part in parts], [part.stats.error_bound for part in parts])
    )
    residual = max(part.stats.residual for part in parts)
    return replace(parts[0], value=value, stats=replace(parts[0].stats, residual=residual, error_bound=error))
