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

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from functools import partial

import numpy as np

from critflow.arguments import checked
from critflow.certificates.prestress import stabilises
from critflow.certificates.uniqueness import require_only_self_stress
from critflow.critical.backbone import backbone
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.transition import dilation, pure_shear
from critflow.extras.tissue.tissue import CriticalTissue
from critflow.extras.tissue.tissue_energy import PerimeterSystem, TissueEnergy, balanced_system
from critflow.linalg.tolerances import EPS
from critflow.networks.deformation import Deformable, Deformation, deformation_of
from critflow.networks.network import Array
from critflow.precision.residual import exact_displacement
from critflow.response.tensor import TRUSTED_ERROR
from critflow.response.third_order import ThirdOrderEnergy, cubed, squared
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.springs.laws import HOOKEAN, SpringLaw

# Largest relative residual of the linear system of the stiffening coefficients; a regular system leaves 1e-14.
CONSISTENT_RESPONSE = 1e-9
NO_WORK = 100.0  # A strain that does less work on the self-stress than this number times its rounding does none
# Unbalanced force of a critical tissue over its mean tension, from which exact balance is a small correction.
BALANCED_TISSUE = 1e-8
# Errors of a tissue are the largest change in two samples of perturbed bond vectors, times ten.
_SAMPLES, _SAMPLE_MARGIN = 2, 10.0


@dataclass(frozen=True, repr=False)
class Stiffening(Record):
    """Moduli at the transition and their first derivatives with strain.

    modulus_0, C  of the modulus (1/V) d²E/dγ² along the path
    """

    bulk_0: float
    shear_0: float
    C_B: float
    C_G: float
    C_G_stress_corrected: float
    modulus_0: float
    C: float


@dataclass(frozen=True, kw_only=True, repr=False)
class StiffeningSolution(Solution[Stiffening]):
    """Coefficients of the moduli.

    loosening  whether positive strains loosen the network: it is then rigid at negative ones, where the coefficients
               hold as well
    """

    loosening: bool = False


NO_STIFFENING = Stiffening(*[np.nan] * 7)


@checked
def stiffening(
    critical: CriticalConfiguration | CriticalTissue,
    throw: bool = True,
    *,
    law: SpringLaw = HOOKEAN,
    deformation: Deformable = "dilation",
    manifold: CriticalManifold | None = None,
) -> StiffeningSolution:
    """Growth of the moduli along a path exactly, from the critical configuration alone: no strain path.

    The module's docstring defines the moduli and coefficients, `third_order` the derivatives E_abc of the energy; with
    t = tr A, dilation δ, shear ε and the path γ,
        C_B = E_δδγ/V − t B_0,   C_G = E_εεγ/V − t G_0,   C = E_γγγ/V − t M_0,   stress-corrected C_G − ½ E_δγ/V.
    A law adds Σ E''' e_δ² e_γ/V to the C_B of Hookean springs, and likewise to the others, with the elongations
    e_a = ḣ_a/|L| = c_a σ̂|L|/k; the moduli at the transition are the same for all laws.

    deformation  what `deformation_of` accepts; antisymmetric parts of A rotate the network and change no modulus
                 to first order but G, whose axes do not rotate
    manifold     of the network, with other stiffnesses for instance; that of the configuration by default

    Springs on perimeters of faces, of `critical_from_perimeters`, have the same coefficients by `tissue_energy`; their
    errors are ten times the largest change in two samples of bond vectors perturbed by their errors.

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
    >>> found = cf.stiffening(cf.optimize(network, 'bulk_modulus')).value
    >>> round(found.C_B / found.bulk_0, 6)  # −1/2 of springs as stiff as their stress
    -0.5
    """
    if isinstance(critical, CriticalTissue):
        solution = _of_tissue(critical, law, deformation_of(deformation, critical.network.dimension))
        return solution.or_raise("no stiffening coefficients") if throw else solution
    if manifold is not None:
        critical = replace(critical, network=critical.springs_of(manifold.network))
    path = deformation_of(deformation, critical.network.dimension)
    relaxing = _relaxing(critical, path)
    if relaxing:
        solution = _failed(Status.floppy, relaxing)
    else:
        parts = backbone(critical).components
        found = [
            _stiffening((manifold if part is critical else None) or part.manifold, part, law, path) for part in parts
        ]
        solution = _total(found)
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

    energy_of = partial(ThirdOrderEnergy, network, critical.sigma, balance.bond_vectors, system, law)
    return _judged(_coefficients(energy_of, network.volume, path))


@dataclass(frozen=True, eq=False)
class _Coefficients:
    """Coefficients with their errors and condition, the energy behind them, and the index of γ among its strains."""

    energy: ThirdOrderEnergy | TissueEnergy
    gamma: int
    value: Stiffening
    error: Stiffening
    condition: float


def _judged(found: _Coefficients) -> StiffeningSolution:
    """The coefficients with the status that their residual, work and errors allow."""
    value, responses = found.value, found.energy.responses
    residual = max(response.residual for response in responses)
    stats = Stats("exact", 1, residual=residual, condition=found.condition, error_bound=found.error)
    if not residual < CONSISTENT_RESPONSE:
        return _failed(Status.singular, "", stats)
    work, rounding = responses[found.gamma].work
    if not work > NO_WORK * rounding:
        return _failed(
            Status.floppy, "the strain does no work on the self-stress, so nothing resists it to first order"
        )
    largest = max(abs(value.bulk_0), abs(value.C_B), abs(value.C_G), abs(value.C))
    if not max(astuple(found.error)) < TRUSTED_ERROR * largest:
        note = "rounding errors may exceed the coefficients: choose stresses of more similar magnitude"
        return _failed(Status.ill_conditioned, note, stats)
    loosening = responses[found.gamma].amplitude < 0
    note = "positive strains loosen the network: the coefficients hold at negative ones" if loosening else ""
    return StiffeningSolution(value, Status.ok, stats, note, loosening=loosening)


def _coefficients(
    energy_of: Callable[[list[Array]], ThirdOrderEnergy | TissueEnergy], volume: float, path: Deformation
) -> _Coefficients:
    """Those of a dilation δ, a shear ε and the path γ of the strained network, which may be the dilation itself."""
    d, V, A, shear = path.dimension, volume, path.rate(0.0), pure_shear(path.dimension)
    gamma = 0 if _dilates(path) else 2
    energy = energy_of([dilation(d), shear] if gamma == 0 else [dilation(d), shear, A])
    thirds = [
        squared(0, gamma, (1 / d) * (1 / d - 1) * np.eye(d), A / d),
        squared(1, gamma, 0 * A, shear @ A),
        cubed(gamma, path.second_rate(0.0)),
    ]
    found = [energy.third(terms) for terms in thirds]
    third = np.array([one.value for one in found]) / V
    errors = [energy.third_error(terms, one.by_length) for terms, one in zip(thirds, found, strict=True)]
    zeroth = np.array([energy.second(a, a) for a in (0, 1, gamma)]) / V
    zeroth_error = np.array([energy.second_error(a, a) for a in (0, 1, gamma)]) / V
    growth = float(np.trace(A))
    half_pressure, pressure_error = 0.5 * energy.second(0, gamma) / V, 0.5 * energy.second_error(0, gamma) / V
    first = third - growth * zeroth
    change = np.array([float(np.sum(one.by_length)) for one in found]) / V
    return _Coefficients(
        energy,
        gamma,
        _ordered(zeroth, first, -half_pressure),
        _ordered(zeroth_error, np.array(errors) / V + abs(growth) * zeroth_error, pressure_error),
        condition=float(np.max(change / np.maximum(np.abs(first), 1e-300))),
    )


def _ordered(zeroth: Array, first: Array, correction: float) -> Stiffening:
    (bulk, shear, modulus), (C_B, C_G, C) = zeroth.tolist(), first.tolist()
    return Stiffening(bulk, shear, C_B, C_G, C_G + correction, modulus, C)


def _of_tissue(tissue: CriticalTissue, law: SpringLaw, path: Deformation) -> StiffeningSolution:
    """The coefficients of springs on perimeters."""
    if law != HOOKEAN:
        raise InputError("springs on perimeters are Hookean: leave out law=")
    if path.free:
        return _failed(Status.floppy, "free components of the cell relax the tensions of a tissue: fix the cell")
    if not ((tissue.face_tensions > 0).all() and tissue.configuration.residual < BALANCED_TISSUE):
        raise InputError("faces without tension and edges without length leave no response: change the perimeters")
    system, errors = balanced_system(tissue)
    if tissue.faces.several_self_stresses(tissue.network, system.bond_vectors):
        raise InputError(
            "this requires one self-stress and the perimeters have several: follow strain_path() and fit its moduli"
        )
    if system.soft:
        return _failed(Status.unstable, "the tensions of the faces do not stabilise all zero modes")
    V, rng = tissue.network.volume, np.random.default_rng(0)
    found = _coefficients(partial(TissueEnergy, system), V, path)
    samples = []
    for _ in range(_SAMPLES):
        noise = (errors * rng.standard_normal(errors.shape))[:, None]
        other = PerimeterSystem(tissue, system.tensions, system.bond_vectors * (1 + noise))
        there = _coefficients(partial(TissueEnergy, other), V, path).value
        samples.append(np.abs(np.subtract(astuple(there), astuple(found.value))))
    changes = _SAMPLE_MARGIN * (np.max(samples, axis=0) + EPS * np.abs(astuple(found.value)))
    error = Stiffening(*map(float, changes))
    return _judged(replace(found, error=error))


def _dilates(path: Deformation) -> bool:
    """Whether the path is the dilation whose coefficients are C_B and C_G of the paper."""
    d = path.dimension
    return bool(
        np.allclose(path.rate(0.0), dilation(d), rtol=0, atol=1e-15)
        and np.allclose(path.second_rate(0.0), (1 / d) * (1 / d - 1) * np.eye(d), rtol=0, atol=1e-15)
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
    unlimited = Stiffening(*[np.inf] * 7)
    stats = stats or Stats("exact", 1, error_bound=unlimited if status is Status.ill_conditioned else np.nan)
    return StiffeningSolution(NO_STIFFENING, status, stats, note)


def _total(parts: list[StiffeningSolution]) -> StiffeningSolution:
    """The sum over taut parts, which are disconnected; the first failure decides the status."""
    for part in parts:
        if not part.ok:
            return part
    if len({part.loosening for part in parts}) > 1:
        return _failed(Status.slack_edges, "the strain stretches some taut parts and loosens others: take each part")
    value, error = (
        Stiffening(*map(float, np.sum([astuple(each) for each in numbers], axis=0)))
        for numbers in ([part.value for part in parts], [part.stats.error_bound for part in parts])
    )
    residual = max(part.stats.residual for part in parts)
    return replace(parts[0], value=value, stats=replace(parts[0].stats, residual=residual, error_bound=error))
