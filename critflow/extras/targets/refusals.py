"""Closed-form bounds that exclude targets at the transition, each a proof.

With w the part of L̇ normal to L in the response to dilation, and c = σ̂·ḣ/D, the third derivative of the energy is
    V C_B = (3/d − 2) V B_0 + 3c Σ σ̂ |w|²,
since the parts along the edges cancel the cubic terms of Hooke's law.  For σ > 0 hence C_B ≥ (3/d − 2) B_0, with
equality at the largest B_0 only (`stiffening_bound`).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from critflow.critical.manifold import CriticalManifold
from critflow.critical.transition import dilation, largest_value, modulus_form, pure_shear
from critflow.extras.targets.problem import Target
from critflow.extras.targets.stress_form import StressForm, stress_form
from critflow.networks.deformation import strain_basis, strain_components
from critflow.networks.network import Array
from critflow.optimisation.largest_modulus import largest_modulus
from critflow.result import InputError

BOUND_ROUNDING = 1e-12  # rounding of a closed-form bound, relative
ONLY_STIFFEST = 1e-9  # relative distance from the largest B_0 within which its own relations count as attained


def refusal_of(manifold: CriticalManifold, targets: Sequence[Target], positive: bool) -> str:
    """A sentence where a closed-form bound excludes the targets, else an empty string.

    positive  whether all stresses are positive
    """
    note = _beyond_extreme(manifold, targets, positive)
    note = note or _beyond_stress(manifold, targets, positive) or _beyond_together(manifold, targets)
    return note or (_beyond_softening(manifold, targets) if positive else "")


def _beyond_extreme(manifold: CriticalManifold, targets: Sequence[Target], positive: bool) -> str:
    """The smallest and the largest possible value of each target alone."""
    for target in targets:
        least, most = target.quantity.extreme(manifold, positive)
        if target.high < 0 <= least:
            signs = ", or choose signs='any'" if target.quantity.extreme(manifold, False)[0] < 0 else ""
            return f"{target.name} is never negative here, and at most {target.high:.8g} was requested: raise it{signs}"
        if target.low > most + BOUND_ROUNDING * abs(most):
            return (
                f"{target.name} is at most {most:.8g}, its bound for every stress of this network, and "
                f"{target.low:.8g} was requested"
            )
        if target.high < least - BOUND_ROUNDING * max(abs(least), abs(target.high)):
            return f"{target.name} is at least {least:.8g} under tension, and {target.high:.8g} was requested"
    return ""


def _stress_forms(targets: Sequence[Target]) -> list[tuple[Target, StressForm]]:
    """The targets that are functions of S/√D, with these."""
    pairs = [(target, stress_form(target.quantity)) for target in targets]
    return [(target, function) for target, function in pairs if function is not None]


def _beyond_stress(manifold: CriticalManifold, targets: Sequence[Target], positive: bool) -> str:
    """What a fully prescribed S implies: its signs, and with C = S⊗S/(V D) every modulus."""
    network = manifold.network
    S = prescribed_stress(network.dimension, targets)
    if S is None:
        return ""
    _, strains = strain_basis(network.dimension)
    matrix = np.einsum("n,nij->ij", S, strains * np.where(np.einsum("nii->n", strains) > 0, 1, 2)[:, None, None])
    if positive and np.linalg.eigvalsh(matrix)[0] <= 0:
        return "S is positive definite where every edge is under tension: choose signs='any', or another S"
    for target, function in _stress_forms(targets):
        implied = float(np.sum(matrix * function.strain)) ** 2 / network.volume
        if function.squared and not target.low * (1 - 1e-9) <= implied <= target.high * (1 + 1e-9):
            raise InputError(f"the targets contradict each other: those of S/√D make {target.name} {implied:.8g}")
    return ""


def _beyond_together(manifold: CriticalManifold, targets: Sequence[Target]) -> str:
    """The bound of several values of moduli and of components of S/√D together, for any signs of S:A.

    S/√D lies in the ellipsoid sᵀ form⁻¹ s ≤ V, so its products C s with some strains in vᵀ (C form Cᵀ)⁻¹ v ≤ V.
    """
    network, (_, strains) = manifold.network, strain_basis(manifold.network.dimension)
    exact = [(t, function) for t, function in _stress_forms(targets) if t.low == t.high]
    if len(exact) < 2:
        return ""
    names = [target.name for target, _ in exact]
    C = np.array([strain_components(function.strain) for _, function in exact])
    v = [np.sqrt(network.volume * target.low) if function.squared else target.low for target, function in exact]
    inverse = np.linalg.pinv(C @ (modulus_form(manifold, strains) * network.volume) @ C.T, hermitian=True)
    fits = list[float]()
    for pattern in product(*((1.0, -1.0) if function.squared else (1.0,) for _, function in exact)):
        values = np.multiply(v, pattern)
        s = np.linalg.lstsq(C, values, rcond=None)[0]
        if np.abs(C @ s - values).max() <= 1e-9 * np.abs(values).max():
            fits.append(float(values @ inverse @ values))
    if not fits:
        raise InputError(f"the targets {', '.join(names)} contradict each other: S/√D of each stress relates them")
    if min(fits) <= 1 + BOUND_ROUNDING:
        return ""
    factor = np.sqrt(min(fits))
    return f"{' and '.join(names)} together exceed the bound of S/√D for every stress by a factor of {factor:.6g}"


def prescribed_stress(dimension: int, targets: Sequence[Target]) -> Array | None:
    """The components S:A of a fully prescribed S/√D in the order of `strain_basis`, or None."""
    _, strains = strain_basis(dimension)
    components = np.full(len(strains), np.nan)
    for target, function in _stress_forms(targets):
        if not function.squared and target.low == target.high:
            components[(strains == function.strain).all(axis=(1, 2))] = target.low
    return None if np.isnan(components).any() else components


def limiting_stress(manifold: CriticalManifold, targets: Sequence[Target]) -> Array | None:
    """σ (N_b,) of the largest S/√D in the direction of a fully prescribed one, over stresses of any sign, or None.

    The bound Sᵀ form⁻¹ S ≤ V is attained by the largest modulus for the strain A = form⁻¹ S, normal to the ellipsoid.
    """
    network = manifold.network
    S = prescribed_stress(network.dimension, targets)
    if S is None or network.dimension != 2 or not S.any():
        return None
    _, strains = strain_basis(2)
    normal = np.einsum("n,nij->ij", np.linalg.solve(modulus_form(manifold, strains), S), strains)
    limit = largest_modulus(manifold, normal / np.linalg.norm(normal)).value
    if not np.isfinite(limit.sigma).all() or not np.isfinite(limit.bond_vectors).all():
        return None
    work = np.einsum("a,ai,ij,aj->", limit.sigma, limit.bond_vectors, normal, limit.bond_vectors, optimize=True)
    return np.asarray(limit.sigma * np.sign(work) / np.sqrt(np.mean(limit.sigma**2)))


def _beyond_softening(manifold: CriticalManifold, targets: Sequence[Target]) -> str:
    """C_B ≥ (3/d − 2) B_0, equal at the largest B_0 only; C_G ≥ −(G_0/3B_0)(C_B − (3/d − 2) B_0)."""
    d = manifold.network.dimension
    growth = {t.quantity.name: t for t in targets if t.quantity.name in ("C_B", "C_G") and not t.sense}
    if not growth:
        return ""
    coefficient, bound = 3 / d - 2, largest_value(manifold, dilation(d))
    lowest, highest = _range_of_modulus(targets, dilation(d), bound)
    bulk = growth.get("C_B")
    if bulk is not None:
        least = coefficient * highest
        if bulk.high < least - BOUND_ROUNDING * bound:
            return (
                f"{bulk.name} is at least {coefficient:.3g} B_0 = {least:.8g} under tension, and {bulk.high:.8g} was "
                "requested"
            )
        if bulk.high < least + ONLY_STIFFEST * bound and highest < bound * (1 - ONLY_STIFFEST):
            return (
                f"{bulk.name} = {coefficient:.3g} B_0 is attained at the largest B_0 = {bound:.8g} only, and at most "
                f"{highest:.8g} was requested"
            )
        if lowest >= bound * (1 - BOUND_ROUNDING) and bulk.low > coefficient * bound * (1 - ONLY_STIFFEST):
            return f"at the largest B_0 = {bound:.8g}, {bulk.name} is {coefficient * bound:.8g} for every configuration"
    shear = growth.get("C_G")
    if bulk is None or shear is None or lowest == 0:
        return ""
    _, shear_modulus = _range_of_modulus(targets, pure_shear(d), largest_value(manifold, pure_shear(d)))
    ratio = bulk.high / (lowest if bulk.high > 0 else highest) - coefficient
    least = -shear_modulus / 3 * ratio
    if shear.high < least - BOUND_ROUNDING * bound:
        return f"{shear.name} is at least {least:.8g} with these targets under tension, not {shear.high:.8g}"
    return ""


def _range_of_modulus(targets: Sequence[Target], strain: Array, bound: float) -> tuple[float, float]:
    """The requested range of the modulus of a strain, inside 0 and its bound."""
    pairs = _stress_forms(targets)
    same = [target for target, function in pairs if function.squared and np.array_equal(function.strain, strain)]
    return max([0.0, *(t.low for t in same)]), min([bound, *(t.high for t in same)])
