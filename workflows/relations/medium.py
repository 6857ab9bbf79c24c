"""Effective-medium theory of stresses on the edges, and laws of independent random stresses.

σ is a conductance of an edge, each coordinate a potential, W = Σσ|L|² twice the power, and ∂W/∂σ_α = |L_α|².  An edge
between vertices of z edges in a uniform medium of conductance m sees the conductance z m/2 between its ends, of which
(z/2 − 1) m belong to the paths around it.  The medium is the one in which an edge of the network has the mean field of
an edge of the medium (Kirkpatrick, Rev. Mod. Phys. 45, 574, 1973):

    Σ (m − σ)/(σ + (z/2 − 1) m) = 0,   W = m Σ|L*|²,   |L_α|² = Σ|L*|² ∂m/∂σ_α
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import erfinv, ndtri

_PROBABILITIES = 100_000  # midpoints at which the quantiles of a law stand for it

# Quantiles of each law: half-normal ones are those of the paper.
LAWS = {
    "half_normal": lambda p: np.sqrt(2) * erfinv(p),
    "exponential": lambda p: -np.log1p(-p),
    "uniform": lambda p: p,
    **{f"log_normal_{s:g}": lambda p, s=s: np.exp(s * ndtri(p)) for s in (0.4, 0.8, 1.2, 2.0)},
}
NAMES = {
    "half_normal": "half-normal",
    "exponential": "exponential",
    "uniform": "uniform",
    **{f"log_normal_{s:g}": f"log-normal {s:g}" for s in (0.4, 0.8, 1.2, 2.0)},
}


def medium(sigma, coordination=3):
    """The conductance m of the medium, one number, of stresses (n,) on edges between vertices of z edges."""
    around = coordination / 2 - 1
    low, high = float(np.min(sigma)), float(np.max(sigma))
    if low == high:
        return low
    # A few stresses may be negative, as long as none cancels the paths around its edge.
    low = max(low, -0.999 * low / around, 1e-12 * high)
    return brentq(lambda m: np.mean((m - sigma) / (sigma + around * m)), low, high, xtol=1e-14 * high, rtol=1e-14)


def share_of_stress(sigma, coordination=3):
    """σ/m (n,), and the mean of (σ/m)/(σ/m + z/2 − 1)² over the edges."""
    x = sigma / medium(sigma, coordination)
    return x, np.mean(x / (x + coordination / 2 - 1) ** 2)


def gap(sigma, coordination=3):
    """max B_0/B_0 − 1 by the theory, for equal stiffnesses: ⟨σ²/(σ + …)²⟩/(m⟨σ/(σ + …)²⟩) − 1."""
    x, mean = share_of_stress(sigma, coordination)
    return float(np.mean((x / (x + coordination / 2 - 1)) ** 2) / mean - 1)


def gap_of_law(law, coordination=3):
    """The same for infinitely many stresses of a law."""
    return gap(LAWS[law]((np.arange(_PROBABILITIES) + 0.5) / _PROBABILITIES), coordination)


def drawn(rng, law, n):
    """n independent stresses of a law."""
    return LAWS[law](rng.random(n))
