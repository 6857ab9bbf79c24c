"""The numbers on the page: results of the library with their errors, to the digits that these leave certain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from critflow.certificates.counts import certify
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.vocabulary import quantity
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array
from critflow.response.elasticity import elasticity
from critflow.response.stiffening import stiffening
from critflow.result import CritflowError

T = TypeVar("T")
PROOF, ESTIMATE = "proof", "estimate"
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
    for key in ("C_B", "C_G", "C_G_stress_corrected"):
        if stiffness is None:
            numbers.append(Number(key, np.nan, note=reason or ""))
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
    """Self-stresses, zero modes and whether the configuration is rigid, with the gap of singular values."""
    certificate, note = _attempt(lambda: certify(critical))
    if certificate is None:
        return [Number(key, np.nan, note=note) for key in ("self-stresses", "zero modes")]
    low, high = certificate.gap
    return [
        Number("self-stresses", certificate.n_self_stresses, note=f"singular values {low:.1e} | {high:.1e}"),
        Number(
            "zero modes",
            certificate.n_zero_modes,
            note="rigid to second order" if certificate.rigid else "not shown to be rigid",
        ),
    ]


def variances(critical: CriticalConfiguration) -> list[Number]:
    """V_L and V_τ.

    Error bound (proof for stresses of one sign): changes δ of values w with mean m change √V = std/m by at most
    (rms δ + √V mean δ)/(m − mean δ), so V by e(2√V + e).
    """
    error = np.where(np.isfinite(critical.bond_errors), critical.bond_errors, np.inf)
    error = error + 4 * EPS * critical.lengths
    numbers = []
    for key, name, values, change in (
        ("V_L", "length_variance", critical.lengths, error),
        ("V_τ", "tension_variance", critical.tensions, np.abs(critical.sigma) * error),
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
