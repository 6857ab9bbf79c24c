"""Claims and verification of the three-bar linkage, from its dataset alone."""

import numpy as np
from scipy.ndimage import binary_dilation, label

from critflow.engine.study import plural
from critflow.result import Status

from ..paper.statements import Measurement
from ..paper.verdicts import claims_of
from ..shared.verification import contradictions
from .figures import FAMILIES, family, span_of


def claims(ds):
    """The statements of the paper on this linkage, tested on the stored grids."""
    return claims_of(measured for part in (_rigid, _singular, _lengths, _forms) for measured in part(ds))


def _checked(ds):
    """Where on the grids the checks were made."""
    return np.ix_(range(ds.sizes["grid"]), ds.checked_row.values, ds.checked_row.values)


def _rigid(ds):
    """Inertia against motion: whether an edge can turn while all keep their length."""
    checked = ds.n_negative.values[_checked(ds)]
    known = (ds.outcome.values == Status.ok)[_checked(ds)]
    definite = np.isin(checked, (0, 2))
    motions = ds.ways_out.values
    agree = known & (definite == (motions == 0)) & (definite == (ds.prestress_stable.values == 1))
    yield Measurement(
        "three-bar-rigid", float(agree.sum() / known.sum()),
        f"at {agree.sum()} of {known.sum()} stresses: no motion if definite, else "
        f"{'/'.join(str(n) for n in np.unique(motions[known & ~definite]))} motions", plural(known.sum(), "stress"),
    )  # fmt: skip
    families = [family(grid) for grid in ds.grid.values]
    pure = {kind: set() for kind in FAMILIES}
    for kind, values in zip(families, ds.n_negative.values, strict=True):
        if kind in pure:
            pure[kind] |= set(np.unique(values).tolist())
    right = {"stretched": {0}, "folded": {0}, "branch": {1}}
    yield Measurement(
        "three-bar-sheets", float(np.mean([pure[kind] == right[kind] for kind in FAMILIES])),
        "negative eigenvalues of P: " + ", ".join(f"{kind} {sorted(n)}" for kind, n in pure.items())
        + f"; sheets: {', '.join(f'{families.count(kind)} {kind}' for kind in FAMILIES)}",
        note="one stretched sheet, and three of each other kind, one for each edge",
    )  # fmt: skip


def _singular(ds):
    """Where P is singular: at an angle arccos(1/√3) from equal stresses."""
    normal, low_high = ds.normal.values, ds.prestress_eigenvalue.values
    product = np.sum(normal * np.roll(normal, 1, axis=-1), axis=-1)
    off = np.abs(low_high.prod(axis=-1) - product).max()
    cone = ((normal.sum(axis=-1) ** 2 > 1) == (low_high.prod(axis=-1) > 0)).mean()
    yield Measurement(
        "three-bar-singular", float(cone) if off < 1e-14 else 0.0,
        f"det P = σ₁σ₂ + σ₂σ₃ + σ₃σ₁ to {off:.1g}: two circles |Σσ| = |σ| (s² = 8 − 4√3 in the chart), with "
        f"rigid stresses inside at {100 * cone:.4g} % of the grid",
    )  # fmt: skip


def _lengths(ds):
    """The two sides of the rigid sheets."""
    definite = ds.n_negative.values == 0
    height = ds.lowest_height.values / span_of(ds) ** 2
    branch = np.isfinite(height) & (ds.n_negative.values == 1)
    below = 100 * (height[branch] < 0).mean()
    above = height[definite][np.isfinite(height[definite])]
    yield Measurement(
        "three-bar-incompatible", float(np.mean(above >= 0)),
        f"1000 random configurations lie at least {above.min():.1g} D² over each of {definite.sum()} rigid tangent "
        f"planes, and some lie below {below:.3g} % of the branch ones",
        note="P definite makes Σσh least at the configuration, so that the compatible h fill a convex set, which the "
        "rigid sheets bound",
    )  # fmt: skip
    allowed = ds.lattice_compatible.values == 1
    # Parts that touch at a point are two points of the lattice apart at most.
    regions, pieces = label(allowed)[1], label(binary_dilation(~allowed, np.ones((3, 3, 3))))[1]
    apart = label(~allowed)[1]
    yield Measurement(
        "three-bar-two-regions", float((regions, pieces) == (1, 1)),
        f"compatible lengths are {plural(regions, 'region')}, incompatible ones {plural(pieces, 'region')}",
        note=f"the incompatible region has {apart} parts, all edges too short or one of three too long, which touch at "
        "points only",
    )  # fmt: skip


def _forms(ds):
    """The metric, and the sign of the second form by finite differences."""
    good = ds.outcome.values == Status.ok
    tangents, metric = ds.tangents.values[good], ds.metric.values[good]
    products = np.einsum("nec,ned->ncd", tangents, tangents)
    off = np.abs(products - metric).max(axis=(1, 2)) / np.abs(tangents).max(axis=(1, 2)) ** 2
    yield Measurement(
        "metric", float(np.mean(off <= 1e-11)), f"largest difference {off.max():.1g} of the squared tangents",
        plural(len(off), "stress"),
    )  # fmt: skip
    trace = np.trace(ds.numeric_second_form.values, axis1=-2, axis2=-1)
    stretched = trace[[family(grid) == "stretched" for grid in ds.grid.values]]
    yield Measurement(
        "second-form", float(np.mean(stretched < 0)),
        f"by differences the form is positive at {100 * np.mean(stretched > 0):.4g} % of stretched stresses, where B "
        "is negative",
    )  # fmt: skip


# Verification


def verify(ds):
    """A line for each grid whose tensions differ in a row, or whose normal or metric contradicts the tangents."""
    return contradictions(ds, ("grid",), _checks)


def _checks(one):
    good = one.outcome.values == Status.ok
    tension = np.abs(one.sigma.values * one.length.values)[good]
    largest = np.abs(one.sigma.values[good]).max(axis=1) * one.length.values[good].max(axis=1)
    normal, tangents = one.normal.values[good], one.tangents.values[good]
    size = np.abs(tangents).max(axis=(1, 2))
    metric = np.einsum("nec,ned->ncd", tangents, tangents)
    yield "tension", (np.ptp(tension, axis=1) <= 1e-11 * largest).all()
    yield "normal", (np.abs(np.einsum("ne,nec->nc", normal, tangents)).max(axis=1) <= 1e-11 * size).all()
    yield "metric", (np.abs(metric - one.metric.values[good]).max(axis=(1, 2)) <= 1e-11 * size**2).all()
