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

from dataclasses import astuple, dataclass, replace

import numpy as np

from critflow.arguments import checked
from critflow.critical.backbone import taut_configurations
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import dilation, pure_shear
from critflow.linalg.saddle import CondensedSaddle, Saddle
from critflow.mechanics.laws import HOOKEAN, SpringLaw
from critflow.mechanics.third_order import ThirdOrderEnergy, Triple
from critflow.mechanics.tolerances import CONSISTENT_RESPONSE, NO_WORK, TRUSTED_ERROR
from critflow.networks.deformation import Deformable, Deformation, deformation_of
from critflow.networks.network import Array, Network
from critflow.precision.residual import exact_displacement
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.rigidity.prestress import stabilises
from critflow.rigidity.uniqueness import require_only_self_stress


@dataclass(frozen=True)
class Stiffening(Record):
    """Moduli at the transition and their first derivatives with strain: C_B, C_G, C_G stress-corrected."""

    bulk_0: float
    shear_0: float
    C_B: float
    C_G: float
    C_G_stress_corrected: float


@dataclass(frozen=True)
class PathStiffening(Record):
    """The modulus (1/V) d²E/dγ² along the path at the transition, M_0, and its first derivative with strain, C."""

    modulus_0: float
    C: float


@dataclass(frozen=True, kw_only=True)
class StiffeningSolution(Solution[Stiffening]):
    """Coefficients of the moduli, and of the modulus along the path, with error bounds (estimates) of the latter.

    loosening  whether positive strains loosen the network: it is then rigid at negative ones, where the coefficients
               hold as well
    """

    along: PathStiffening
    along_error: PathStiffening
    loosening: bool = False


NO_STIFFENING = Stiffening(np.nan, np.nan, np.nan, np.nan, np.nan)
_UNBOUNDED = Stiffening(np.inf, np.inf, np.inf, np.inf, np.inf)
_NO_PATH, _UNBOUNDED_PATH = PathStiffening(np.nan, np.nan), PathStiffening(np.inf, np.inf)


@checked
def stiffening(
    network: Network | CriticalManifold,
    critical: CriticalConfiguration,
    throw: bool = True,
    *,
    law: SpringLaw = HOOKEAN,
    deformation: Deformable = "dilation",
) -> StiffeningSolution:
    """Growth of the moduli along a path exactly, from the critical configuration alone: no strain path.

    The module's docstring defines the moduli and coefficients, `third_order` the derivatives E_abc of the energy; with
    t = tr A, dilation δ, shear ε and the path γ,
        C_B = E_δδγ/V − t B_0,   C_G = E_εεγ/V − t G_0,   C = E_γγγ/V − t M_0,   stress-corrected C_G − ½ E_δγ/V.
    A law adds Σ E''' e_δ² e_γ/V to the C_B of Hookean springs, and likewise to the others, with the elongations
    e_a = ḣ_a/|L| = c_a σ̂|L|/k; the moduli at the transition are the same for all laws.

    deformation  what `deformation_of` accepts; antisymmetric parts of A rotate the network and change no modulus
                 to first order but G, whose axes do not rotate

    Slack edges, σ = 0, resist nothing; disconnected taut parts add up.  The value is that of the configuration in exact
    balance under the floating-point σ, found from the given coordinates in extended precision.

    Error bound (estimate): `stats.error_bound` limits the errors against it; errors of first order are exact, roundings
    are summed by `accumulated_rounding`.  `stats.condition` is the largest factor by which relative errors of bond
    vectors are amplified in the coefficients.

    `Status.unstable` and NaN where P(σ̂) is not positive on the zero modes, so that no response exists;
    `Status.undecided` where rounding hides whether it is;
    `Status.ill_conditioned` and NaN where the bound exceeds a tenth of the largest coefficient;
    `Status.floppy` and NaN where the strain does no work on the self-stress, or free components of the cell relax it.
    Raises `InputError` for configurations with several self-stresses, and for free components that leave it as it is.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = cf.stiffening(network, cf.optimize(network, 'bulk_modulus')).value
    >>> round(found.C_B / found.bulk_0, 6)  # −1/2 of springs as stiff as their stress
    -0.5
    """
    manifold = CriticalManifold.of(network)
    critical = replace(critical, network=critical.springs_of(manifold.network))
    path = deformation_of(deformation, manifold.network.dimension)
    relaxing = _relaxing(critical, path)
    if relaxing:
        solution = _failed(Status.floppy, relaxing)
    else:
        parts = taut_configurations(critical)
        found = [
            _stiffening(manifold if part is critical else CriticalManifold(part.network), part, law, path)
            for part in parts
        ]
        solution = found[0] if len(found) == 1 else _total(found)
    return solution.or_raise("no stiffening coefficients") if throw else solution


def _stiffening(
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
        return _failed(Status.undecided if undecided else Status.unstable, note)
    factor = manifold.prestress.factorize_signed(critical.sigma)
    balance = exact_displacement(network, critical.coordinates, lambda _: critical.sigma, factor.solve)
    if not np.isfinite(balance.remainder):
        return _failed(Status.ill_conditioned, "rounding hides which configuration balances this stress exactly")

    growth = (_of_dilation if _dilates(path) else _of_path)(
        network, critical.sigma, balance.bond_vectors, system, law, path
    )
    energy, value, along = growth.energy, growth.value, growth.along
    residual = max(response.residual for response in energy.responses)
    coefficients = [value.C_B, value.C_G] if _dilates(path) else [value.C_B, value.C_G, along.C]
    condition = max(
        change / network.volume / max(abs(C), 1e-300)
        for change, C in zip(energy.sensitivity, coefficients, strict=True)
    )
    stats = Stats("exact", 1, residual=residual, condition=condition, error_bound=growth.bound)
    if not residual < CONSISTENT_RESPONSE:
        return _failed(Status.singular, "", stats)
    work, rounding = energy.work(growth.gamma)
    if not work > NO_WORK * rounding:
        return _failed(
            Status.floppy, "the strain does no work on the self-stress, so nothing resists it to first order"
        )
    largest = max(abs(value.bulk_0), *(abs(C) for C in coefficients))
    if not max(*astuple(growth.bound), *astuple(growth.along_bound)) < TRUSTED_ERROR * largest:
        note = "rounding errors may exceed the coefficients: choose stresses of more similar magnitude"
        return _failed(Status.ill_conditioned, note, stats)
    loosening = energy.responses[growth.gamma].amplitude < 0
    note = "positive strains loosen the network: the coefficients hold at negative ones" if loosening else ""
    return StiffeningSolution(
        value, Status.ok, stats, note, along=along, along_error=growth.along_bound, loosening=loosening
    )


@dataclass(frozen=True, eq=False)
class _Growth:
    """Coefficients with their bounds, the energy behind them, and the index of γ among its strains."""

    energy: ThirdOrderEnergy
    gamma: int
    value: Stiffening
    bound: Stiffening
    along: PathStiffening
    along_bound: PathStiffening


def _dilates(path: Deformation) -> bool:
    """Whether the path is the dilation whose coefficients are C_B and C_G of the paper."""
    d, unit = path.dimension, np.eye(path.dimension)
    return bool(
        np.allclose(path.rate(0.0), dilation(d), rtol=0, atol=1e-15)
        and np.allclose(path.second_rate(0.0), (1 / d) * (1 / d - 1) * unit, rtol=0, atol=1e-15)
    )


def _of_dilation(
    network: Network, sigma: Array, L: Array, system: Saddle | CondensedSaddle, law: SpringLaw, path: Deformation
) -> _Growth:
    """δ is γ itself, with E_δδγ = E_γγγ + 2 E_γγ since volumes multiply."""
    d, V, A = network.dimension, network.volume, pure_shear(network.dimension)
    triples = (
        Triple.cubed(0, (1 / d) * (1 / d - 1) * np.eye(d)),
        Triple.squared(1, 0, 0 * A, A / d),
    )
    energy = ThirdOrderEnergy(network, sigma, L, system, law, (dilation(d), A), triples)
    (bulk, shear), (bulk_error, shear_error) = energy.third, energy.third_error
    bulk_0, shear_0 = (energy.second(a, a) / V for a in (0, 1))
    error_0, shear_error_0 = (energy.second_error(a, a) / V for a in (0, 1))
    C_B, C_G = (energy.second(0, 0) + bulk) / V, (shear - energy.second(1, 1)) / V
    C_B_error, C_G_error = bulk_error / V + error_0, shear_error / V + shear_error_0
    return _Growth(
        energy,
        0,
        Stiffening(bulk_0, shear_0, C_B, C_G, C_G - 0.5 * bulk_0),
        Stiffening(error_0, shear_error_0, C_B_error, C_G_error, C_G_error + 0.5 * error_0),
        PathStiffening(bulk_0, C_B - 2 * bulk_0),
        PathStiffening(error_0, C_B_error + 2 * error_0),
    )


def _of_path(
    network: Network, sigma: Array, L: Array, system: Saddle | CondensedSaddle, law: SpringLaw, path: Deformation
) -> _Growth:
    """Any path γ with dilation δ and shear ε of the strained network."""
    d, V, A, shear = network.dimension, network.volume, path.rate(0.0), pure_shear(network.dimension)
    dilating, shearing, along = 0, 1, 2
    triples = (
        Triple.squared(dilating, along, (1 / d) * (1 / d - 1) * np.eye(d), A / d),
        Triple.squared(shearing, along, 0 * A, shear @ A),
        Triple.cubed(along, path.second_rate(0.0)),
    )
    energy = ThirdOrderEnergy(network, sigma, L, system, law, (dilation(d), shear, A), triples)
    growth = float(np.trace(A))
    bulk_0, shear_0, modulus_0 = zeroth = [energy.second(a, a) / V for a in (dilating, shearing, along)]
    zeroth_error = [energy.second_error(a, a) / V for a in (dilating, shearing, along)]
    C_B, C_G, C = (third / V - growth * modulus for third, modulus in zip(energy.third, zeroth, strict=True))
    bulk_error, shear_error, path_error = (
        third / V + abs(growth) * error for third, error in zip(energy.third_error, zeroth_error, strict=True)
    )
    pressure, pressure_error = 0.5 * energy.second(dilating, along) / V, 0.5 * energy.second_error(dilating, along) / V
    return _Growth(
        energy,
        along,
        Stiffening(bulk_0, shear_0, C_B, C_G, C_G - pressure),
        Stiffening(zeroth_error[0], zeroth_error[1], bulk_error, shear_error, shear_error + pressure_error),
        PathStiffening(modulus_0, C),
        PathStiffening(zeroth_error[along], path_error),
    )


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


def _failed(status: Status, note: str, stats: Stats | None = None) -> StiffeningSolution:
    stats = stats or Stats("exact", 1, error_bound=_UNBOUNDED if status is Status.ill_conditioned else np.nan)
    return StiffeningSolution(NO_STIFFENING, status, stats, note, along=_NO_PATH, along_error=_UNBOUNDED_PATH)


def _total(found: list[StiffeningSolution]) -> StiffeningSolution:
    """The sum over disconnected taut parts; the first failure decides the status."""
    for solution in found:
        if not solution.ok:
            return solution
    if len({solution.loosening for solution in found}) > 1:
        return _failed(Status.slack_edges, "the strain stretches some taut parts and loosens others: take each part")
    first, stats = found[0], [solution.stats for solution in found]
    bound = Stiffening(*_sum([astuple(stat.error_bound) for stat in stats]))
    return replace(
        first,
        value=Stiffening(*_sum([astuple(solution.value) for solution in found])),
        along=PathStiffening(*_sum([astuple(solution.along) for solution in found])),
        along_error=PathStiffening(*_sum([astuple(solution.along_error) for solution in found])),
        stats=replace(stats[0], residual=max(stat.residual for stat in stats), error_bound=bound),
    )


def _sum(rows: list[tuple[float, ...]]) -> list[float]:
    return [float(total) for total in np.sum(rows, axis=0)]
