"""Claims and verification of the three-bar linkage, from its dataset alone."""

import numpy as np
from scipy.ndimage import label

from critflow.result import Status
from critflow.workflow import Claim
from critflow.workflow.study import plural

from ..shared.verification import contradictions
from .figures import FAMILIES, family, span_of


def claims(ds):
    """The statements of the paper on this linkage, tested on the stored grids."""
    return [claim for make in (_rigid, _singular, _lengths, _forms) for claim in make(ds)]


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
    yield Claim.tested(
        "3-barlinkage-rigid", "orange and purple stresses (P definite) are rigid, grey ones (P indefinite) are branch "
        "points", "by region",
        f"at {agree.sum()} of {known.sum()} stresses: no motion if definite, else "
        f"{'/'.join(str(n) for n in np.unique(motions[known & ~definite]))} motions", (agree == known).all(),
        "inertia and motion disagree", criterion="every stress", sample=plural(known.sum(), "stress"), kind="paper",
    )  # fmt: skip
    families = [family(grid) for grid in ds.grid.values]
    pure = {kind: set() for kind in FAMILIES}
    for kind, values in zip(families, ds.n_negative.values, strict=True):
        if kind in pure:
            pure[kind] |= set(np.unique(values).tolist())
    yield Claim.tested(
        "3-barlinkage-sheets", "the manifold has rigid sheets like A and B and branch sheets like C",
        "orange, purple, grey",
        "negative eigenvalues of P: " + ", ".join(f"{kind} {sorted(n)}" for kind, n in pure.items())
        + f"; sheets: {', '.join(f'{families.count(kind)} {kind}' for kind in FAMILIES)}",
        pure == {"stretched": {0}, "folded": {0}, "branch": {1}}, "a sheet changes its inertia",
        "one stretched sheet, and three of each other kind, one for each edge", criterion="every stress", kind="paper",
    )  # fmt: skip


def _singular(ds):
    """Where P is singular: at an angle arccos(1/√3) from equal stresses."""
    normal, low_high = ds.normal.values, ds.prestress_eigenvalue.values
    product = np.sum(normal * np.roll(normal, 1, axis=-1), axis=-1)
    off = np.abs(low_high.prod(axis=-1) - product).max()
    cone = ((normal.sum(axis=-1) ** 2 > 1) == (low_high.prod(axis=-1) > 0)).mean()
    yield Claim.tested(
        "3-barlinkage-D", "the map is undefined on a curve (red) between the rigid and the branch stresses", "red line",
        f"det P = σ₁σ₂ + σ₂σ₃ + σ₃σ₁ to {off:.1g}: two circles |Σσ| = |σ| (s² = 8 − 4√3 in the chart), with "
        f"rigid stresses inside at {100 * cone:.4g} % of the grid", off < 1e-14 and cone == 1, "another curve",
        criterion="1e-14, every stress", kind="paper",
    )  # fmt: skip


def _lengths(ds):
    """The two sides of the rigid sheets."""
    definite = ds.n_negative.values == 0
    height = ds.lowest_height.values / span_of(ds) ** 2
    branch = np.isfinite(height) & (ds.n_negative.values == 1)
    below = 100 * (height[branch] < 0).mean()
    yield Claim.tested(
        "3-barlinkage-G", "lengths beyond the rigid sheets are compatible, those before them impossible", "two sides",
        f"1000 random configurations lie at least {np.nanmin(height[definite]):.1g} D² over each of {definite.sum()} "
        f"rigid tangent planes, and some lie below {below:.3g} % of the branch ones", np.nanmin(height[definite]) >= 0,
        "some are below a rigid one",
        "P definite makes Σσh least at the configuration, so the compatible h fill a convex set, which the rigid "
        "sheets bound", criterion="no configuration below a rigid tangent plane", kind="paper",
    )  # fmt: skip
    allowed = ds.lattice_compatible.values == 1
    regions, pieces = label(allowed)[1], label(~allowed)[1]
    yield Claim.tested(
        "3-barlinkage-G-regions", "the rigid sheets divide the space of lengths into two separate regions",
        "two regions", f"compatible lengths are {regions} piece, incompatible ones {pieces}",
        regions == 1 and pieces == 1,
        "all edges too short is one piece, and each of the three edges too long another; they touch at points only",
        criterion="one piece each", kind="paper",
    )  # fmt: skip
    yield Claim.tested(
        "3-barlinkage-G-floppy", "compatible rest lengths give a floppy configuration like A", "like A",
        f"A has {ds.example_n_self_stresses.values[0]} self-stress and no motion", False,
        "A is rigid, as in the caption of the figure; floppy configurations lie off the manifold",
        criterion="no self-stress at A", kind="paper",
    )  # fmt: skip


def _forms(ds):
    """The sign of the second form by finite differences, and that of the curvature."""
    numeric = ds.numeric_second_form.values
    trace = np.trace(numeric, axis1=-2, axis2=-1)
    stretched = trace[[family(grid) == "stretched" for grid in ds.grid.values]]
    yield Claim.tested(
        "2FF", "II = Σσ ∂²h/∂s∂s / |σ| = +VᵀBV/|σ|", "+",
        f"by finite differences II is positive at {100 * np.mean(stretched > 0):.4g} % of stretched stresses, where B "
        "is negative", not (stretched > 0).all(),
        "differentiating σᵀB = 0 gives Σσ ∂B = −B, so II = −VᵀBV/|σ|; the printed derivation (`2FF2`) ends at "
        "+R^h P⁻¹ R^hᵀ and calls it ∂h/∂σ, which is −R^h P⁻¹ R^hᵀ (`tangents`)", criterion="sign", kind="paper",
    )  # fmt: skip
    kappa = ds.principal_curvature.values
    ok = ds.outcome.values == Status.ok
    rigid, both = (ds.n_negative.values != 1)[ok], (kappa.prod(axis=-1) > 0)[ok]
    yield Claim.tested(
        "2FF-sign", "(not in the paper) rigid sheets are elliptic, branch sheets are saddles", "—",
        f"K > 0 at {100 * both[rigid].mean():.4g} % of rigid and {100 * both[~rigid].mean():.4g} % of branch stresses",
        bool(both[rigid].all() and not both[~rigid].any()), "signs are mixed",
        criterion="every stress", kind="check",
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
