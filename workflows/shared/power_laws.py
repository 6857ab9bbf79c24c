"""Power laws in the size of the network, with confidence intervals."""

import numpy as np

from critflow.engine import stable_rng

# Resampled ensembles behind a confidence interval.
_RESAMPLED = 1000


def exponent(sizes, values, middle=np.nanmean):
    """Exponent p of middle ∝ size^p over networks, values (n_sizes, n_networks), with its 95 % interval by resampling.

    The middle, mean or median, is fitted on logarithmic scales, all sizes alike; NaN networks are left out.
    """
    values = np.asarray(values, dtype=float)
    n = values.shape[1]
    picks = stable_rng(n, "exponent").integers(0, n, (_RESAMPLED, n))
    low, high = np.nanquantile(_slopes(sizes, middle(values[:, picks], axis=2)), (0.025, 0.975))
    return float(_slopes(sizes, middle(values, axis=1))), float(low), float(high)


def _slopes(sizes, means):
    """Least-squares slopes of log mean against log size over the first dimension; NaN unless all means are positive."""
    lever = np.log(sizes) - np.log(sizes).mean()
    return np.tensordot(lever, np.log(np.where(means > 0, means, np.nan)), 1) / np.sum(lever**2)


def shown(fit):
    """An exponent with its interval, as text."""
    return f"{fit[0]:.2f} (95 %: {fit[1]:.2f} to {fit[2]:.2f})"


def quoted(fit):
    """An exponent with its interval, for a legend."""
    return f"{fit[0]:.2f} [{fit[1]:.2f}, {fit[2]:.2f}]"
