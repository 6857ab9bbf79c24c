"""What the paper leaves open: random stresses, growth under shear, pairs of lengths and tensions, the largest moduli.

docs/theory/random_stresses.md and docs/theory/relations.md have the proofs; this study tries each relation on networks.

    medium      B_0 of independent random stresses of several laws against effective-medium theory, which has no
                parameter, in the plane and in space; and of the populations, with their stresses in place and shuffled
    shear       mean of C_G over all pure shears against its lower bound: of the populations, then in the cell in which
                G_0 = 0, the affine image whose macroscopic stress is isotropic; in space; with compressed edges
    pairs       eigenvalues of −∂ln|L|/∂ln σ, C_B by the curvature of the manifold, and its bound by missing stiffness
    moduli      the largest G_0, over stresses of any sign, and the largest B_0
"""

import numpy as np

from critflow import CriticalManifold, Status, elasticity, upper_bound, voronoi_network
from critflow.engine import Coordinate, Study, stable_rng
from critflow.growth import shear_growth
from critflow.isogonal import length_shares
from critflow.points import STANDARD_HARD_CORE, check_voronoi, random_sequential_addition
from critflow.quantities import quantity
from critflow.result import CritflowError

from ..shared.checks import check_known, check_network, check_positive
from ..shared.measurements import known_stiffening
from ..shared.populations import MEANING, PAPER_POPULATIONS, POPULATIONS, SETTINGS, configuration, prepared
from ..shared.reports import PAPER
from ..shared.tables import networks, numbers, outcomes, stacked
from .figures import growth_figure, histogram_figure, medium_figure, pairs_figure
from .medium import LAWS, drawn, gap, share_of_stress
from .report import claims

VERTICES_A_CELL = 6.77  # of a Voronoi network of random points in space
SPACE_HARD_CORE = 0.8
MEASURED = (
    *("B_0", "gap", "medium_gap", "shuffled_gap", "C_G_mean", "C_G_bound", "isotropic_ratio"),
    *("C_B", "B_0_error_bound", "C_B_error_bound", "curvature_C_B", "missing_stiffness_C_B", "asymmetry"),
)


def case(parameters, *, seed):
    """All relations on one network."""
    manifold = prepared(voronoi_network, parameters["n_vertices"], seed, parameters["hard_core"])
    rows = [_population(manifold, parameters, seed, population) for population in parameters["populations"]]
    space = CriticalManifold(space_network(parameters["space_vertices"], stable_rng(seed, "relations", "space")))
    return {
        "status": Status.ok,
        **stacked(rows),
        **stacked([_law(manifold, parameters, seed, law) for law in parameters["laws"]]),
        "space_gap": [
            np.mean([_gap(space, sigma)[0] for sigma in _stresses(space, parameters, seed, law)])
            for law in parameters["laws"]
        ],
        "space_ratio": [_space_ratio(space, seed, law) for law in parameters["laws"]],
        **stacked([_signed(parameters, seed, sample) for sample in range(parameters["signed_samples"])]),
        **_largest(manifold),
    }


# Random stresses


def space_network(n_vertices, rng):
    """A Voronoi network in space, of about n vertices, four edges each."""
    n = round(n_vertices / VERTICES_A_CELL)
    return voronoi_network(points=random_sequential_addition(n, SPACE_HARD_CORE / n ** (1 / 3), rng, dimension=3))


def _gap(manifold, sigma):
    """max B_0/B_0 − 1 and |L|² (N_b,) of one stress; B_0 = (Σσ|L|²)²/(d²VΣσ²|L|²/k)."""
    L = manifold.balance(sigma).bond_vectors
    square, d = np.sum(L**2, axis=1), manifold.network.dimension
    B_0 = (sigma @ square) ** 2 / (d**2 * manifold.network.volume * (sigma**2 @ square))
    return upper_bound(manifold, "B_0") / B_0 - 1, square


def _stresses(manifold, parameters, seed, law):
    rng = stable_rng(seed, "relations", law, str(manifold.network.dimension))
    return [drawn(rng, law, manifold.network.n_edges) for _ in range(parameters["draws"])]


def _law(manifold, parameters, seed, law):
    """The gap of one law, and |L|² against σ/m in the unit of the theory, in which it is 1/(σ/m + ½)² for every law."""
    bins = np.array(parameters["bins"])
    places = np.concatenate([[0.0], np.sqrt(bins[1:] * bins[:-1]), [np.inf]])
    equal = np.mean(np.sum(manifold.balance(manifold.network.stiffness).bond_vectors ** 2, axis=1))
    gaps, total, count = [], np.zeros(len(bins)), np.zeros(len(bins), int)
    for sigma in _stresses(manifold, parameters, seed, law):
        one, square = _gap(manifold, sigma)
        x, mean = share_of_stress(sigma)
        gaps.append(one)
        # Each edge by what the theory predicts for it, so that a wide bin has no error of its own.
        predicted = 1 / (mean * (x + 0.5) ** 2)
        inside = np.digitize(x, places[1:-1])
        total += np.bincount(inside, square / equal / predicted, len(bins))
        count += np.bincount(inside, minlength=len(bins))
    with np.errstate(invalid="ignore"):
        ratio = np.where(count > 0, total / count, np.nan)
    return {"law_gap": np.mean(gaps), "square_ratio": ratio, "square_count": count}


# Populations


def _population(manifold, parameters, seed, population):
    """The outcome and `MEASURED` of one population, with the eigenvalues of its pairs."""
    found = configuration(manifold, parameters, seed, population)
    n = manifold.network.n_edges
    result = {"solve_status": found.status, "shares": np.full(n, np.nan)} | dict.fromkeys(MEASURED, np.nan)
    if found.status is not Status.ok:
        return result
    critical, rng = found.value, stable_rng(seed, "relations", "shuffled", population)
    sigma, (known, errors) = critical.sigma, known_stiffening(None, critical, "dilation")
    result |= {"B_0_error_bound": errors.bulk_0, "C_B_error_bound": errors.C_B}
    result |= {"B_0": known.bulk_0, "C_B": known.C_B, "gap": upper_bound(manifold, "B_0") / known.bulk_0 - 1}
    if not (sigma > 0).all():
        return result
    growth, isotropic = shear_growth(critical), in_isotropic_cell(critical)
    shares, curvature = curvature_growth(critical)
    return result | {
        "medium_gap": gap(sigma),
        "shuffled_gap": np.mean([_gap(manifold, rng.permutation(sigma))[0] for _ in range(parameters["draws"])]),
        "C_G_mean": growth.mean,
        "C_G_bound": growth.bound,
        "isotropic_ratio": ratio_to_bulk(isotropic),
        "curvature_C_B": curvature,
        "missing_stiffness_C_B": missing_stiffness_growth(manifold, critical),
        "shares": shares,
        "asymmetry": asymmetry(shares, manifold.network.n_vertices),
    }


def in_isotropic_cell(critical):
    """The affine image of a configuration whose macroscopic stress Σσ LLᵀ is isotropic; None if that is not definite.

    The same σ balances every affine image.  No pure shear works on this one: G_0 = 0 for all of them.
    """
    network, L, sigma = critical.network, critical.bond_vectors, critical.sigma
    values, axes = np.linalg.eigh((L.T * sigma) @ L)
    if not (values > 0).all():
        return None
    F = (axes / np.sqrt(values)) @ axes.T
    F /= np.linalg.det(F) ** (1 / len(F))
    return CriticalManifold(network.deformed(F)).configuration(sigma)


def ratio_to_bulk(critical):
    """The mean of C_G over all pure shears, over B_0."""
    return shear_growth(critical).mean / elasticity(critical).value.bulk


def curvature_growth(critical):
    """Eigenvalues of the shares β (N_b,) in ascending order, and C_B by the curvature of the manifold.

    C_B = (3/d − 2)B_0 + (3dB_0/T)(xᵀβ⁺x − xᵀx) with x = √σ|L|(1/d − cσ/k) and T = Σσ|L|², c = T/(dΣσ²|L|²/k).
    """
    network, sigma, square = critical.network, critical.sigma, critical.lengths**2
    d, k, beta = network.dimension, network.stiffness, length_shares(critical)
    T = sigma @ square
    c = T / (d * (sigma**2 @ (square / k)))
    B_0 = c * T / (d * network.volume)
    x = np.sqrt(sigma * square) * (1 / d - c * sigma / k)
    shares, modes = np.linalg.eigh(beta)
    y = modes.T @ x
    stiff = shares > 1e-9  # the one zero is the scale of the stress, to which x is orthogonal
    return shares, (3 / d - 2) * B_0 + 3 * d * B_0 / T * (np.sum(y[stiff] ** 2 / shares[stiff]) - x @ x)


def missing_stiffness_growth(manifold, critical):
    """The lower bound of C_B by the missing stiffness ΔB; NaN at the largest B_0, where it is 0/0.

    C_B ≥ (3/d − 2)B_0 + 3d³V²B_0 ΔB²/(T Σ(k²/σ)|L*_⊥|²) with L*_⊥ the part of the bond vector at σ = k across the edge.
    """
    network, sigma, L = critical.network, critical.sigma, critical.bond_vectors
    d, V, k, unit = network.dimension, network.volume, network.stiffness, L / critical.lengths[:, None]
    star = manifold.balance(k).bond_vectors
    across = np.sum((star - np.sum(star * unit, axis=1)[:, None] * unit) ** 2, axis=1)
    B_0, most = elasticity(critical).value.bulk, upper_bound(manifold, "B_0")
    if not most - B_0 > 1e-9 * most:
        return np.nan
    T = sigma @ critical.lengths**2
    return (3 / d - 2) * B_0 + 3 * d**3 * V**2 * B_0 * (most - B_0) ** 2 / (T * np.sum(k**2 / sigma * across))


def asymmetry(shares, n_vertices):
    """The largest distance of a pair λ, 1 − λ from its sum 1, without the scale of the stress and isogonal modes."""
    pairs = shares[1 : n_vertices + 1]
    return float(np.abs(pairs + pairs[::-1] - 1).max())


# Other stresses of the theorem on C_G


def _space_ratio(space, seed, law):
    """The ratio in space, of the first stress of each law."""
    sigma = drawn(stable_rng(seed, "relations", "space", law), law, space.network.n_edges)
    try:
        return ratio_to_bulk(in_isotropic_cell(space.configuration(sigma)))
    except CritflowError:  # edges too short for a status other than ill-conditioned
        return np.nan


def _signed(parameters, seed, sample):
    """A small network with one to three compressed edges: the ratio, and whether P is positive definite."""
    rng = stable_rng(seed, "relations", "signs", str(sample))
    network = voronoi_network(int(rng.choice([8, 12, 20, 30])), rng)
    sigma = np.exp(rng.standard_normal(network.n_edges))
    squeezed = rng.choice(network.n_edges, rng.integers(1, 4), replace=False)
    sigma[squeezed] *= -rng.choice([0.1, 0.3, 1.0])
    try:
        critical = in_isotropic_cell(CriticalManifold(network).configuration(sigma))
        ratio = np.nan if critical is None else ratio_to_bulk(critical)
    except CritflowError:  # P singular, or the stress does not stabilise the zero modes
        ratio = np.nan
    g = network.free_incidence.toarray()
    definite = np.linalg.eigvalsh(g.T @ (sigma[:, None] * g))[0] > 0
    return {"signed_ratio": ratio, "signed_definite": int(definite)}


def _largest(manifold):
    """The largest B_0 and G_0 over stresses of any sign, and the term of the anisotropy at σ = k between them."""
    network = manifold.network
    L = manifold.balance(network.stiffness).bond_vectors
    M = (network.stiffness[:, None] * L).T @ L
    largest = [quantity(network, name).extreme(manifold, positive=False)[1] for name in ("B_0", "G_0")]
    term = (M[0, 0] - M[1, 1]) ** 2 / (4 * network.volume * np.trace(M))
    return {"largest_B_0": largest[0], "largest_G_0": largest[1], "anisotropy_term": term}


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_known("population", parameters["populations"], POPULATIONS)
    check_known("law", parameters["laws"], LAWS)
    check_positive(parameters, "draws", "signed_samples", "threshold", "spread", "hard_core", "space_vertices")
    check_network(check_voronoi, parameters["n_vertices"], parameters["hard_core"])


OF_POPULATION, OF_LAW = ("seed", "population"), ("seed", "law")
study = Study(
    name="relations",
    title="What the paper leaves open: random stresses, growth under shear, pairs, the largest moduli",
    references=PAPER,
    axes=(networks(20),),
    parameters={
        "n_vertices": 400,
        "space_vertices": 400,
        "hard_core": STANDARD_HARD_CORE,
        **SETTINGS,
        "draws": 10,
        "signed_samples": 60,
        "populations": PAPER_POPULATIONS,
        "laws": tuple(LAWS),
        "bins": tuple(float(f"{x:.3g}") for x in np.geomspace(0.05, 6.4, 15)),
    },
    coordinates=(
        Coordinate("population", "populations", MEANING),
        Coordinate("law", "laws", "law of independent random stresses; the number is the standard deviation of log σ"),
        Coordinate("bin", "bins", "σ/m in the middle of a bin, m the conductance of the medium"),
    ),
    case=case,
    check=check,
    variables=(
        *numbers(
            OF_POPULATION,
            B_0="bulk modulus at the transition, in units of k",
            gap="max B_0/B_0 − 1",
            medium_gap="max B_0/B_0 − 1 by effective-medium theory of the histogram of the stresses",
            shuffled_gap="max B_0/B_0 − 1 with the stresses in random order, mean over the draws",
            C_G_mean="mean of C_G over both pure shears, energy convention, in units of k",
            C_G_bound="lower bound of C_G_mean, in units of k",
            isotropic_ratio="mean of C_G over B_0 in the cell in which G_0 = 0",
            B_0_error_bound="bound on the rounding error of B_0",
            C_B="growth of the bulk modulus with strain, in units of k",
            C_B_error_bound="bound on the rounding error of C_B",
            curvature_C_B="C_B by the curvature of the critical manifold, in units of k",
            missing_stiffness_C_B="lower bound of C_B by the stiffness missing to max B_0, in units of k",
            asymmetry="largest |λ + λ' − 1| of pairs of shares",
        ),
        *numbers((*OF_POPULATION, "edge"), shares="eigenvalues of −∂ln|L|/∂ln σ, ascending"),
        *outcomes(OF_POPULATION, solve_status="outcome of finding the configuration"),
        *numbers(
            OF_LAW,
            law_gap="max B_0/B_0 − 1 of random stresses, mean over the draws",
            space_gap="max B_0/B_0 − 1 of random stresses in space, mean over the draws",
            space_ratio="mean of C_G over B_0 in space, in the cell in which G_0 = 0, of one stress",
        ),
        *numbers((*OF_LAW, "bin"), square_ratio="mean |L|² of the edges of a bin over that of effective-medium theory"),
        *numbers((*OF_LAW, "bin"), "i4", square_count="edges of a bin"),
        *numbers(
            ("seed", "sample"), signed_ratio="mean of C_G over B_0 of a small network with compressed edges, G_0 = 0"
        ),
        *numbers(("seed", "sample"), "i1", signed_definite="whether P is positive definite there"),
        *numbers(
            ("seed",),
            largest_B_0="largest B_0 of any stress, in units of k",
            largest_G_0="largest G_0 of stresses of any sign, in units of k",
            anisotropy_term="(M_xx − M_yy)²/(4V tr M) at σ = k, M = Σ k LLᵀ, in units of k",
        ),
        *outcomes(("seed",), status="outcome of the case"),
    ),
    figures={
        "medium": medium_figure,
        "histogram": histogram_figure,
        "growth": growth_figure,
        "pairs": pairs_figure,
    },
    claims=claims,
)
