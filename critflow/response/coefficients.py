"""Stiffening coefficients from second and third derivatives E_ab and E_abc of the relaxed energy.

Along a dilation δ, a shear ε and a path γ with A = F'(0), M = F''(0) and t = tr A,
    C_B = E_δδγ/V − t B_0,   C_G = E_εεγ/V − t G_0,   C = E_γγγ/V − t M_0,   stress-corrected C_G − ½ E_δγ/V.
The springs bring the derivatives: those on edges by `ThirdOrderEnergy`, others by an energy of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import Protocol

import numpy as np

from critflow.critical.transition import dilation, pure_shear
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array
from critflow.response.tensor import TRUSTED_ERROR
from critflow.response.third_order import Term, ThirdDerivative, cubed, squared
from critflow.result import Record, Solution, Stats, Status

# Largest relative residual of the linear system of the stiffening coefficients; a regular system leaves 1e-14.
CONSISTENT_RESPONSE = 1e-9
NO_WORK = 100.0  # A strain that does less work on the self-stress than this number times its rounding does none


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


class StrainResponse(Protocol):
    """First-order response to one strain: amplitude c of the self-stress, work with its rounding error, residual."""

    @property
    def amplitude(self) -> float: ...
    @property
    def work(self) -> tuple[float, float]: ...
    @property
    def residual(self) -> float: ...


class RelaxedEnergy(Protocol):
    """Second and third derivatives of an energy in strains of which the vertices follow, with errors (estimates)."""

    @property
    def responses(self) -> Sequence[StrainResponse]:
        """Those to the strains, in their order."""

    def second(self, a: int, b: int) -> float:
        """E_ab."""

    def second_error(self, a: int, b: int) -> float:
        """Error of E_ab."""

    def third_with_error(self, terms: Sequence[Term]) -> ThirdDerivative:
        """E_abc of the terms."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients with their errors and condition, the energy behind them, and the index of γ among its strains."""

    energy: RelaxedEnergy
    gamma: int
    value: Stiffening
    error: Stiffening
    condition: float


def with_status(exact: Coefficients) -> StiffeningSolution:
    """The coefficients with the status that their residual, work and errors allow."""
    value, responses = exact.value, exact.energy.responses
    residual = max(response.residual for response in responses)
    stats = Stats("exact", 1, residual=residual, condition=exact.condition, error_bound=exact.error)
    if not residual < CONSISTENT_RESPONSE:
        return failed(Status.singular, "", stats)
    work, rounding = responses[exact.gamma].work
    if not work > NO_WORK * rounding:
        return failed(Status.floppy, "the strain does no work on the self-stress, so nothing resists it to first order")
    largest = max(abs(value.bulk_0), abs(value.C_B), abs(value.C_G), abs(value.C))
    if not max(astuple(exact.error)) < TRUSTED_ERROR * largest:
        note = "rounding errors may exceed the coefficients: choose stresses of more similar magnitude"
        return failed(Status.ill_conditioned, note, stats)
    loosening = responses[exact.gamma].amplitude < 0
    note = "positive strains loosen the network: the coefficients hold at negative ones" if loosening else ""
    return StiffeningSolution(value, Status.ok, stats, note, loosening=loosening)


def coefficients(energy_of: Callable[[list[Array]], RelaxedEnergy], volume: float, path: Deformation) -> Coefficients:
    """Those of a dilation δ, a shear ε and the path γ of the strained network, which may be the dilation itself."""
    d, V, A, shear = path.dimension, volume, path.rate(0.0), pure_shear(path.dimension)
    gamma = 0 if _dilates(path) else 2
    energy = energy_of([dilation(d), shear] if gamma == 0 else [dilation(d), shear, A])
    thirds = [
        squared(0, gamma, (1 / d) * (1 / d - 1) * np.eye(d), A / d),
        squared(1, gamma, 0 * A, shear @ A),
        cubed(gamma, path.second_rate(0.0)),
    ]
    derivatives = [energy.third_with_error(terms) for terms in thirds]
    third = np.array([one.value for one in derivatives]) / V
    errors = [one.error for one in derivatives]
    zeroth = np.array([energy.second(a, a) for a in (0, 1, gamma)]) / V
    zeroth_error = np.array([energy.second_error(a, a) for a in (0, 1, gamma)]) / V
    growth = float(np.trace(A))
    half_pressure, pressure_error = 0.5 * energy.second(0, gamma) / V, 0.5 * energy.second_error(0, gamma) / V
    first = third - growth * zeroth
    change = np.array([one.change for one in derivatives]) / V
    return Coefficients(
        energy,
        gamma,
        _ordered(zeroth, first, -half_pressure),
        _ordered(zeroth_error, np.array(errors) / V + abs(growth) * zeroth_error, pressure_error),
        condition=float(np.max(change / np.maximum(np.abs(first), 1e-300))),
    )


def _ordered(zeroth: Array, first: Array, correction: float) -> Stiffening:
    (bulk, shear, modulus), (C_B, C_G, C) = zeroth.tolist(), first.tolist()
    return Stiffening(bulk, shear, C_B, C_G, C_G + correction, modulus, C)


def _dilates(path: Deformation) -> bool:
    """Whether the path is the dilation whose coefficients are C_B and C_G of the paper."""
    d = path.dimension
    return bool(
        np.allclose(path.rate(0.0), dilation(d), rtol=0, atol=1e-15)
        and np.allclose(path.second_rate(0.0), (1 / d) * (1 / d - 1) * np.eye(d), rtol=0, atol=1e-15)
    )


def failed(status: Status, note: str, stats: Stats | None = None) -> StiffeningSolution:
    """No coefficients, for a reason."""
    unlimited = Stiffening(*[np.inf] * 7)
    stats = stats or Stats("exact", 1, error_bound=unlimited if status is Status.ill_conditioned else np.nan)
    return StiffeningSolution(NO_STIFFENING, status, stats, note)
