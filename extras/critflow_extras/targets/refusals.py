"""Closed-form bounds that exclude targets at the transition, each a proof.

With w the part of L̇ normal to L in the response to dilation, and c = σ̂·ḣ/D, the third derivative of the energy is
    V C_B = (3/d − 2) V B_0 + 3c Σ σ̂ |w|²,
since the parts along the edges cancel the cubic terms of Hooke's law.  For σ > 0 hence C_B ≥ (3/d − 2) B_0, with
equality at the largest B_0 only.  With v and c' of a shear, likewise,
    V C_G = (2/d − 1) V G_0 + Σ σ̂ (c |v|² + 2c' v·w) ≥ (2/d − 1) V G_0 − (c'²/c) Σ σ̂ |w|²,   c'²/c² = G_0/B_0.

A bound excludes a target that is beyond it by more than rounding: a configuration is never refused its own values.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from critflow.deformation import strain_basis, strain_components
from critflow.manifold import CriticalManifold
from critflow.networks import Array
from critflow.numerics import norms
from critflow.optima import largest_modulus
from critflow.quantities import SpringResponse, dilation, largest_value, pure_shear
from critflow.result import InputError
from critflow_extras.design_names.components import modulus_form
from critflow_extras.local.local_quantity import LocalStrain
from critflow_extras.targets.problem import Target
from critflow_extras.targets.stress_form import StressForm, stress_form

BOUND_ROUNDING = 1e-12  # rounding of a closed-form bound, relative
ONLY_STIFFEST = 1e-9  # relative distance from the largest B_0 below which a requested B_0 is not the largest
# Distance of C_B from its value at the largest B_0, in units of B_0, that rounding cannot explain: B_0 is stationary
# there, so that stresses may be off by 1e-6 while B_0 is to 1e-12, and C_B by its square times that of the anisotropy.
NOT_STIFFEST = 1e-2
CONTRADICTION = 1e-9  # relative error of targets that S/√D relates to each other
INDEPENDENT_STRAINS = 1e-6  # least eigenvalue of a form of strains of unit size that rounding leaves its digits
# Moments of a network in some direction, relative to the largest, or moduli for some strain, that may be rounding.
_FLAT = 1e-12


def refusal_of(manifold: CriticalManifold, targets: Sequence[Target], positive: bool) -> str:
    """A sentence where a closed-form bound excludes the targets, else an empty string.

    positive  whether all stresses are positive
    """
    note = _beyond_extreme(manifold, targets, positive)
    note = note or _beyond_reciprocity(targets)
    note = note or _beyond_stress(manifold, targets, positive) or _beyond_together(manifold, targets)
    return note or (_beyond_softening(manifold, targets) if positive else "")


def _beyond_extreme(manifold: CriticalManifold, targets: Sequence[Target], positive: bool) -> str:
    """The smallest and the largest possible value of each target alone."""
    network = manifold.network
    # A bound is a sum over eigenvalues of Σ k L*L*ᵀ, each with the rounding of the largest: on a line or a plane in a
    # tilted cell some vanish, and the bound with them.
    moment = float(network.stiffness @ norms(manifold.balance(network.stiffness).bond_vectors) ** 2)
    for target in targets:
        least, most = target.quantity.extreme(manifold, positive)
        function, rounding = stress_form(target.quantity), 0.0
        if function is not None and not function.squared:
            rounding = float(np.sqrt(most**2 + BOUND_ROUNDING * moment)) - most
        elif isinstance(target.quantity, SpringResponse):
            rounding = BOUND_ROUNDING * moment / network.volume
        if target.high < 0 <= least:
            signs = ", or choose signs='any'" if target.quantity.extreme(manifold, False)[0] < 0 else ""
            return f"{target.name} is never negative here, and at most {target.high:.8g} was requested: raise it{signs}"
        if target.low > most + BOUND_ROUNDING * abs(most) + rounding:
            return (
                f"{target.name} is at most {most:.8g}, its bound for every stress of this network, and "
                f"{target.low:.8g} was requested"
            )
        if target.high < least - BOUND_ROUNDING * max(abs(least), abs(target.high)) - rounding:
            return f"{target.name} is at least {least:.8g} under tension, and {target.high:.8g} was requested"
    return ""


def _beyond_reciprocity(targets: Sequence[Target]) -> str:
    """The responses of two pairs to each other have the product G_ts²/(G_ss G_tt), and vanish together.

    G is positive definite, so that the product is between 0 and 1.
    """
    local = [(target, target.quantity) for target in targets if isinstance(target.quantity, LocalStrain)]
    for n, (one, forth) in enumerate(local):
        for other, back in local[:n]:
            pairs = ((back.target, forth.source), (forth.target, back.source))
            if forth.stress != back.stress or not all(a in (b, b.reversed) for a, b in pairs):
                continue
            # The limits of both on one side of zero, as magnitudes.
            sides = [(one.low, one.high, other.low, other.high), (-one.high, -one.low, -other.high, -other.low)]
            attained = [max(a, 0.0) * max(c, 0.0) <= 1 + BOUND_ROUNDING for a, b, c, d in sides if b > 0 < d]
            if not any(attained) and not (one.low <= 0 <= one.high and other.low <= 0 <= other.high):
                return (
                    f"{other.name} and {one.name} are the responses of two pairs to each other: their product is "
                    "between 0 and 1, and both vanish together"
                )
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
    if positive and _has_compression(manifold, matrix):
        return "S is positive definite where every edge is under tension: choose signs='any', or another S"
    for target, function in _stress_forms(targets):
        parts = matrix * function.strain
        work, rounding = abs(float(parts.sum())), CONTRADICTION * float(np.abs(parts).sum())
        low, high = np.sqrt(np.maximum([target.low, target.high], 0) * network.volume)
        if function.squared and not low - rounding <= work <= high + rounding:
            implied = work**2 / network.volume
            raise InputError(f"the targets contradict each other: those of S/√D make {target.name} {implied:.8g}")
    return ""


def _has_compression(manifold: CriticalManifold, S: Array) -> bool:
    """Whether no positive stress has this S (d, d): it is not positive definite, or has a negative eigenvalue.

    n·S n = Σσ (n·L)² is zero where no edge has a component along n.  That is so for all σ > 0 or for none, as in a
    line of edges or a plane of them in space.
    """
    k, L_star = manifold.network.stiffness, manifold.balance(manifold.network.stiffness).bond_vectors
    moments, values = np.linalg.eigvalsh((k[:, None] * L_star).T @ L_star), np.linalg.eigvalsh(S)
    flat = moments[0] <= _FLAT * moments[-1]
    return bool(values[0] < -BOUND_ROUNDING * np.abs(values).max() if flat else values[0] <= 0)


def _beyond_together(manifold: CriticalManifold, targets: Sequence[Target]) -> str:
    """The bound of several values of moduli and of components of S/√D together, for any signs of S:A.

    S/√D lies in the ellipsoid sᵀ form⁻¹ s ≤ V, so its products C s with some strains in vᵀ (C form Cᵀ)⁻¹ v ≤ V.  Of
    strains in units of their largest moduli rounding leaves all digits of this form, however much a network is
    stretched.  Where strains depend on each other up to rounding, leaving out an eigenvalue widens the bound.
    """
    exact = _exact_forms(manifold, targets)
    if len(exact) < 2:
        return ""
    volume, names = manifold.network.volume, [target.name for target, _ in exact]
    C = np.array([strain_components(function.strain) for _, function in exact])
    v = [np.sqrt(volume * target.low) if function.squared else target.low for target, function in exact]
    sizes = np.sqrt([largest_value(manifold, function.strain) for _, function in exact])
    strains = np.array([function.strain / size for size, (_, function) in zip(sizes, exact, strict=True)])
    eigenvalues, vectors = np.linalg.eigh(modulus_form(manifold, strains))
    kept = eigenvalues > INDEPENDENT_STRAINS
    whitened = vectors[:, kept] / np.sqrt(eigenvalues[kept]) / (sizes * np.sqrt(volume))[:, None]
    fits = list[float]()
    for pattern in product(*((1.0, -1.0) if function.squared else (1.0,) for _, function in exact)):
        values = np.multiply(v, pattern)
        s = np.linalg.lstsq(C, values, rcond=None)[0]
        if np.abs(C @ s - values).max() <= CONTRADICTION * np.abs(values).max():
            fits.append(float(np.sum((values @ whitened) ** 2)))
    if not fits:
        raise InputError(f"the targets {', '.join(names)} contradict each other: S/√D of each stress relates them")
    if min(fits) <= 1 + BOUND_ROUNDING / eigenvalues[kept].min(initial=1.0):
        return ""
    factor = np.sqrt(min(fits))
    return f"{' and '.join(names)} together exceed the bound of S/√D for every stress by a factor of {factor:.6g}"


def _exact_forms(manifold: CriticalManifold, targets: Sequence[Target]) -> list[tuple[Target, StressForm]]:
    """The targets with one value that are functions of S/√D, but for strains that change no length up to rounding."""
    exact = [(target, function) for target, function in _stress_forms(targets) if target.low == target.high]
    if len(exact) < 2:
        return []
    network = manifold.network
    size = float(network.stiffness @ norms(manifold.balance(network.stiffness).bond_vectors) ** 2) / network.volume
    values = [largest_value(manifold, function.strain) for _, function in exact]
    least = [_FLAT * size * float(np.sum(function.strain**2)) for _, function in exact]
    return [one for one, value, limit in zip(exact, values, least, strict=True) if value > limit]


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
    """C_B ≥ (3/d − 2) B_0, equal at the largest B_0 only; C_G ≥ (2/d − 1) G_0 − (G_0/3B_0)(C_B − (3/d − 2) B_0)."""
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
        # Values next to it may be attained where only edges that are nearly slack turn.
        if bulk.high <= least and highest < bound * (1 - ONLY_STIFFEST):
            return (
                f"{bulk.name} = {coefficient:.3g} B_0 is attained at the largest B_0 = {bound:.8g} only, and at most "
                f"{highest:.8g} was requested"
            )
        if lowest >= bound * (1 - BOUND_ROUNDING) and bulk.low > coefficient * bound + NOT_STIFFEST * bound:
            return f"at the largest B_0 = {bound:.8g}, {bulk.name} is {coefficient * bound:.8g} for every configuration"
    shear = growth.get("C_G")
    if bulk is None or shear is None or lowest == 0:
        return ""
    largest_shear = largest_value(manifold, pure_shear(d))
    _, shear_modulus = _range_of_modulus(targets, pure_shear(d), largest_shear)
    ratio = bulk.high / (lowest if bulk.high > 0 else highest) - coefficient
    # C_B is above its own bound here, so that the ratio is not negative and the least C_G is at the largest G_0.
    least = shear_modulus * (2 / d - 1 - max(ratio, 0.0) / 3)
    if shear.high < least - BOUND_ROUNDING * max(bound, largest_shear):
        return f"{shear.name} is at least {least:.8g} with these targets under tension, not {shear.high:.8g}"
    return ""


def _range_of_modulus(targets: Sequence[Target], strain: Array, bound: float) -> tuple[float, float]:
    """The requested range of the modulus of a strain, inside 0 and its bound."""
    pairs = _stress_forms(targets)
    same = [target for target, function in pairs if function.squared and np.array_equal(function.strain, strain)]
    return max([0.0, *(t.low for t in same)]), min([bound, *(t.high for t in same)])
