"""The numbers on the page: results of the library with their errors, to the digits that these leave certain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from critflow.elastic import elasticity
from critflow.growth import stiffening
from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.networks import Array, Network
from critflow.numerics import EPS
from critflow.quantities import quantity
from critflow.result import CritflowError
from critflow_extras.certificates.certify import certify
from critflow_extras.certificates.counts import n_rotations, rigidity

T = TypeVar("T")
PROOF, ESTIMATE = "proof", "estimate"
# Rows of the counts.
COUNTS = ("self-stresses", "floppy modes")
# Digits of a number without an error, most decimals, and digits shown until the others are asked for.
_PLAIN, _MOST, _SHORT = 6, 17, 4


@dataclass(frozen=True)
class Number:
    """A number with the largest error that it may have, NaN if unknown.

    kind  `PROOF` or `ESTIMATE`, of the error
    note  the reason where there is no value
    """

    key: str
    value: float
    error: float = np.nan
    kind: str = ""
    note: str = ""

    @property
    def text(self) -> str:
        """The value to the digits that its error leaves certain up to one unit in ten of the last one."""
        if not np.isfinite(self.value):
            return "—"
        if isinstance(self.value, int | np.integer):
            return f"{self.value:d}"
        if not (np.isfinite(self.error) and self.error > 0):
            return f"{self.value:.{_PLAIN}g}"
        decimals = int(np.floor(-np.log10(self.error))) - 1
        if abs(self.value) and decimals > _MOST:
            digits = decimals + 1 + int(np.floor(np.log10(abs(self.value))))
            return f"{self.value:.{min(digits - 1, _MOST - 1)}e}" if digits > 0 else "0"
        return f"{self.value:.{max(decimals, 0)}f}"

    @property
    def short(self) -> str:
        """The value to four digits, or to those of `text` if they are fewer."""
        digits = self.text.partition("e")[0].replace(".", "").lstrip("-0")
        whole = isinstance(self.value, int | np.integer)
        return self.text if whole or len(digits) <= _SHORT else f"{self.value:#.{_SHORT}g}"

    @property
    def row(self) -> dict[str, str]:
        """The texts of a row of the table."""
        known = np.isfinite(self.value) and np.isfinite(self.error) and self.error > 0
        error = f"± {self.error:.1e} ({self.kind})" if known else ""
        return {"key": self.key, "text": self.text, "short": self.short, "error": error, "note": self.note}


def quick(critical: CriticalConfiguration) -> list[Number]:
    """Moduli, variances and residual, without errors of the moduli: shown while a slider moves."""
    return moduli(critical, errors=False) + variances(critical) + [Number("residual", critical.residual)]


def precise(manifold: CriticalManifold, critical: CriticalConfiguration) -> list[Number]:
    """The moduli with their errors, and the stiffening coefficients with theirs."""
    stiffness, reason = _attempt(lambda: stiffening(critical, throw=False, manifold=manifold))
    numbers = moduli(critical, errors=True)
    reason = reason or ""
    for key in ("C_B", "C_G", "C_G_stress_corrected"):
        if stiffness is None:
            numbers.append(Number(key, np.nan, note=reason))
            # One reason of three rows.
            reason = "as C_B"
            continue
        value, error = getattr(stiffness.value, key), getattr(stiffness.stats.error_bound, key, np.nan)
        numbers.append(Number(key, float(value), float(error), ESTIMATE, "" if stiffness.ok else stiffness.reason))
    return numbers


def moduli(critical: CriticalConfiguration, errors: bool) -> list[Number]:
    """B_0 and G_0."""
    found, note = _attempt(lambda: elasticity(critical))
    if found is None or not found:
        note = note if found is None else found.reason
        return [Number("B_0", np.nan, note=note), Number("G_0", np.nan, note=note)]
    value = found.value
    bounds = (value.errors.bulk, value.errors.shear) if errors else (np.nan, np.nan)
    # Those of several self-stresses are estimates.
    kind = "" if not errors else PROOF if found.stats.method == "transition" else ESTIMATE
    return [Number("B_0", value.bulk, bounds[0], kind), Number("G_0", value.shear, bounds[1], kind)]


def counts(critical: CriticalConfiguration) -> list[Number]:
    """Self-stresses, floppy modes and whether the configuration is rigid, with the gap of singular values."""
    certificate, note = _attempt(lambda: certify(critical))
    if certificate is None:
        return [Number(key, np.nan, note=note) for key in COUNTS]
    rigid = "rigid to second order" if certificate.rigid else "not shown to be rigid"
    counted = certificate.n_self_stresses, certificate.n_zero_modes, certificate.gap
    return _counted(*counted, critical.network, critical.coordinates, rigid)


def moduli_at_rest(network: Network, coordinates: Array) -> list[Number]:
    """B and G of springs at rest at coordinates (N_v, d)."""
    solution, note = _attempt(lambda: elasticity(network, coordinates))
    if solution is None or not solution.ok:
        note = note if solution is None else solution.reason
        return [Number("B", np.nan, note=note), Number("G", np.nan, note="as B")]
    value = solution.value
    errors = (value.errors.bulk, value.errors.shear)
    return [Number("B", value.bulk, errors[0], ESTIMATE), Number("G", value.shear, errors[1], ESTIMATE)]


def counts_at_rest(network: Network, coordinates: Array) -> list[Number]:
    """Self-stresses and floppy modes of coordinates (N_v, d) that are not critical."""
    solution, note = _attempt(lambda: rigidity(network, coordinates))
    if solution is None:
        return [Number(key, np.nan, note=note) for key in COUNTS]
    value = solution.value
    rigid = "rigid to first order" if value.first_order_rigid else "not rigid to first order"
    gap = value.largest_zero, value.smallest_nonzero
    return _counted(value.n_self_stresses, value.n_zero_modes, gap, network, coordinates, rigid)


def _counted(
    n_self_stresses: int, n_zero_modes: int, gap: tuple[float, float], network: Network, coordinates: Array, rigid: str
) -> list[Number]:
    """The rows of both counts; floppy modes are those zero modes that are no motions of the whole network."""
    trivial = 0 if network.pins else network.dimension
    stresses = Number(COUNTS[0], n_self_stresses, note=f"singular values {gap[0]:.1e} | {gap[1]:.1e}")
    return [stresses, Number(COUNTS[1], n_zero_modes - trivial - n_rotations(network, coordinates), note=rigid)]


def variances(critical: CriticalConfiguration) -> list[Number]:
    """V_L and V_τ.

    Error bound (proof for stresses of one sign): changes δ of values w with mean m change √V = std/m by at most
    (rms δ + √V mean δ)/(m − mean δ), so V by e(2√V + e).
    """
    error = np.where(np.isfinite(critical.bond_errors), critical.bond_errors, np.inf)
    error = error + 4 * EPS * critical.lengths
    numbers = []
    for key, name, values, change in (
        ("V_L", "V_L", critical.lengths, error),
        ("V_tau", "V_tau", critical.tensions, np.abs(critical.sigma) * error),
    ):
        value = quantity(critical.network, name).evaluate(critical)[0]
        numbers.append(Number(key, value, _variance_error(value, values, change), PROOF))
    return numbers


def _variance_error(variance: float, values: Array, change: Array) -> float:
    mean, shift = float(abs(values.mean())), float(change.mean())
    if not (np.isfinite(shift) and shift < mean):
        return np.nan
    root = float(np.sqrt(variance))
    error = (float(np.sqrt(np.mean(change**2))) + root * shift) / (mean - shift)
    # The sums of N_b terms round the mean and the variance.
    rounding = EPS * np.log2(len(values) + 2)
    return error * (2 * root + error) + 4 * rounding * variance + (2 * rounding) ** 2


def _attempt(compute: Callable[[], T]) -> tuple[T | None, str]:
    """The result, or None and the reason."""
    try:
        return compute(), ""
    except CritflowError as error:
        return None, str(error)
