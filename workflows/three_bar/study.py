"""The whole critical manifold of the three-bar linkage, rigid sheets and branch points, as a surface.

The paper's `3-barlinkage` and `CriticalManifoldGeometry`.  The chart grid covers every stress up to its sign; the
other grids follow one sheet each in signed lengths r_α ∝ 1/σ_α, which add up to the span on all seven sheets.
"""

import numpy as np

from critflow import CriticalManifold, Status, three_bar_linkage
from critflow.engine import Axis, Coordinate, Study, decimals, stable_rng
from critflow.manifold import COLLAPSED
from critflow.result import StudyError
from critflow.self_stress import Spectrum, stabilises

from ..paper.verdicts import committed_run
from ..shared.checks import check_positive
from ..shared.reports import PAPER
from ..shared.tables import numbers, outcomes, stacked
from .chart import StereographicChart, surface_geometry
from .curvature import curvature_figure
from .figures import geometry_figure, manifold_figure
from .report import claims, verify

# Grids of the whole chart and, twice as fine, of its middle, which contains the rigid sheets.
CHARTS = {"chart": 1.0, "middle": 0.5}
SHEETS = ("stretched", *(f"{kind}_{edge}" for kind in ("folded", "branch") for edge in (1, 2, 3)))
EXAMPLES = ("stretched", "folded", "branch", "floppy")
# Rows and columns between the stresses with finite differences and motions of the linkage.
STRIDE = 6


def stresses(grid, nodes, reach):
    """Stresses of a grid (n, n, 3): of the chart at its nodes, of a sheet by signed lengths up to `reach` spans."""
    n = len(nodes)
    if grid in CHARTS:
        chart, at = StereographicChart.about(np.ones(3)), CHARTS[grid] * nodes
        return np.array([[chart.sigma(np.array([s_1, s_2])) for s_1 in at] for s_2 in at])
    # Closer together at the ends, where lengths vanish, but not on them: there is no tangent plane.
    even = np.sin(np.linspace(0.03, np.pi / 2 - 0.03, n)) ** 2
    far, part = np.meshgrid(even, even, indexing="ij")
    if grid == "stretched":
        r = np.stack([1 - far, far * part, far * (1 - part)])
        edge = 1
    else:
        kind, edge = grid.split("_")
        far = (reach - 1) * far
        # One long edge with both others pointing back, or one edge pointing back against both others.
        r = np.stack([1 + far, -far * part, -far * (1 - part)])
        if kind == "branch":
            r = np.stack([-far, (1 + far) * part, (1 + far) * (1 - part)])
    sigma = np.moveaxis(np.roll(1 / r, int(edge) - 1, axis=0), 0, -1)
    return sigma * np.sign(sigma.sum(axis=-1, keepdims=True))


def at_point(manifold, chart, sigma):
    """The manifold at one stress: configuration, inertia and, where a tangent plane exists, its geometry."""
    found = manifold.solve(sigma)
    critical, normal = found.value, sigma / np.linalg.norm(sigma)
    g = manifold.network.free_incidence.toarray()
    s = chart.coordinates(sigma)
    point = {
        "s": s,
        "sigma": critical.sigma,
        "normal": normal,
        "prestress_eigenvalue": np.linalg.eigvalsh(g.T @ (normal[:, None] * g)),
        "n_negative": found.negative_pivots,
        "outcome": found.status,
        "length": critical.lengths,
        "position": critical.coordinates,
        "position_error_bound": critical.error_bound,
    }
    if found.ok and not critical.lengths.min() > COLLAPSED * critical.lengths.mean():
        point["outcome"] = Status.edge_collapse
    if point["outcome"] is Status.ok:
        tangents, metric, form = surface_geometry(manifold, critical, chart, s)
        # The chart is conformal, VᵀV = c²1, so that the eigenvalues of the second form over c² are the radii.
        radii = np.linalg.eigvalsh((form + form.T) / 2) * (1 + s @ s / 4) ** 2
        point |= {
            "tangents": tangents,
            "metric": metric,
            "second_form": form,
            "principal_curvature": np.sort(1 / radii),
        }
    else:
        shapes = {"tangents": (3, 2), "metric": (2, 2), "second_form": (2, 2), "principal_curvature": (2,)}
        point |= {name: np.full(shape, np.nan) for name, shape in shapes.items()}
    return point


def check_at(manifold, chart, point):
    """Checks at one stress: the second form by finite differences of h, stability, finite motions."""
    s, span = point["s"], manifold.network.pins[3][0]
    sigma = chart.sigma(s)

    def height(a, b):
        return sigma @ manifold.configuration(chart.sigma(s + np.array([a, b]))).lengths ** 2 / 2

    # The distance to the nearest place without a tangent plane sets the length on which the surface changes.
    e = 2e-3 * min(float(np.abs(sigma).min()), float(np.abs(point["prestress_eigenvalue"]).min()))
    middle, mixed = 2 * height(0, 0), (height(e, e) - height(e, -e) - height(-e, e) + height(-e, -e)) / 4
    network, x = manifold.network, point["position"]
    L, one_stress = network.bond_vectors(x), Spectrum(network, x).n_self_stresses == 1
    first, second = (height(*step) + height(*-step) - middle for step in e * np.eye(2))
    return {
        "numeric_second_form": np.array([[first, mixed], [mixed, second]]) / e**2,
        "prestress_stable": one_stress and any(stabilises(network, x, L, sign * point["sigma"]) for sign in (1, -1)),
        "ways_out": len(finite_motions(np.diff(x[:, 0]), span, 1e-3)),
    }


def finite_motions(r, span, angle):
    """Positions of the two free vertices, with all lengths kept, after the first edge of a line turns by ±angle.

    A rigid line has no such positions.
    """
    motions = []
    for turn in (angle, -angle):
        first = r[0] * np.array([np.cos(turn), np.sin(turn)])
        motions += [(first, second) for second in meeting_points(first, np.array([span, 0.0]), abs(r[1]), abs(r[2]))]
    return motions


def meeting_points(a, b, to_a, to_b):
    """Points at given distances from two points in the plane: two, or none."""
    apart = np.linalg.norm(b - a)
    distance = (apart**2 + to_a**2 - to_b**2) / (2 * apart)
    height = to_a**2 - distance**2
    if not height > 0:
        return []
    unit = (b - a) / apart
    across = np.array([-unit[1], unit[0]]) * np.sqrt(height)
    return [a + distance * unit + across, a + distance * unit - across]


def examples(manifold):
    """Four configurations, stretched, folded, branch point and floppy, and where each can move."""
    span = manifold.network.pins[3][0]
    pins = np.array([[0.0, 0.0], [span, 0.0]])
    lines = {"stretched": (0.44, 0.24, 0.32), "folded": (1.42, -0.24, -0.18), "branch": (0.62, -0.2, 0.58)}
    out = []
    for name in EXAMPLES:
        if name in lines:
            r = span * np.array(lines[name])
            critical = manifold.configuration(1 / r)
            x, sigma = critical.coordinates, critical.sigma
            frames = [frame for turn in (0.12, 0.24) for frame in finite_motions(r, span, turn)]
        else:
            angles = [0.45, 0.65, 0.55, 0.3, 0.15, 0.0, -0.15, -0.3, -0.45]
            first = 0.4 * span * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            frames = [(a, meeting_points(a, pins[1], 0.38 * span, 0.36 * span)[1]) for a in first]
            x, sigma = np.array([pins[0], *frames.pop(0), pins[1]]), np.full(3, np.nan)
        motion = np.full((8, 4, 2), np.nan)
        for stored, frame in zip(motion, frames, strict=False):
            stored[:] = pins[0], *frame, pins[1]
        out.append({"sigma": sigma, "position": x, "motion": motion})
    return {f"example_{name}": values for name, values in stacked(out).items()}


def compatible(span, squares):
    """Whether edges of these squared lengths can join the pins, on a lattice (n, n, n)."""
    L = np.sqrt(squares)
    one, two, three = np.meshgrid(L, L, L, indexing="ij")
    # The first edge ends between |D − L₁| and D + L₁ from the far pin, the other two bridge |L₂ − L₃| to L₂ + L₃.
    return (np.abs(span - one) <= two + three) & (np.abs(two - three) <= span + one)


def case(parameters, *, grid):
    """One grid of stresses: configurations, inertia, metric, curvature, and checks of them on some of its points."""
    span, nodes = parameters["span"], np.array(parameters["s"])
    manifold, chart = CriticalManifold(three_bar_linkage(span)), StereographicChart.about(np.ones(3))
    points = [[at_point(manifold, chart, sigma) for sigma in row] for row in stresses(grid, nodes, parameters["reach"])]
    result = stacked([stacked(row) for row in points])
    # Heights of random configurations over each tangent plane: none is below a rigid one.
    free = span * stable_rng(0, "configurations").normal(0.5, 1.0, (1000, 2, 2))
    x = np.concatenate([np.zeros((1000, 1, 2)), free, np.tile([span, 0.0], (1000, 1, 1))], axis=1)
    h = np.sum(np.diff(x, axis=1) ** 2, axis=2) / 2
    normal, here = result["normal"], result["length"] ** 2 / 2
    result["lowest_height"] = np.array([(h @ n).min() for n in normal.reshape(-1, 3)]).reshape(normal.shape[:2])
    result["lowest_height"] -= np.sum(normal * here, axis=-1)
    chosen = range(STRIDE // 2, len(nodes), STRIDE)
    empty = {"numeric_second_form": np.full((2, 2), np.nan), "prestress_stable": False, "ways_out": 0}
    checked = [[points[row][column] for column in chosen] for row in chosen]
    checks = [[check_at(manifold, chart, p) if p["outcome"] is Status.ok else empty for p in row] for row in checked]
    squares = (span * np.linspace(0.03, 2.4, 24)) ** 2
    return {
        "status": Status.ok,
        **result,
        **stacked([stacked(row) for row in checks]),
        **examples(manifold),
        "checked_row": chosen,
        "basis": chart.basis,
        "lattice_square": squares,
        "lattice_compatible": compatible(span, squares).astype(int),
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_positive(parameters, "span")
    if not parameters["reach"] > 1:
        raise StudyError(f"reach={parameters['reach']} must be more than 1: lengths are followed up to that many spans")
    if len(parameters["s"]) < 2 * STRIDE:
        raise StudyError(f"s needs at least {2 * STRIDE} values: s=-2.1:2.1:0.1 covers every stress")


POINT, CHECKED = ("grid", "row", "column"), ("grid", "check_row", "check_column")
VARIABLES = (
    *numbers((*POINT, "chart_axis"), s="stereographic coordinates about equal stresses"),
    *numbers(
        (*POINT, "edge"),
        sigma="geometric stress (tension per length), sum of squares N_b",
        normal="stress of unit norm, normal to the manifold",
        length="edge length",
    ),
    *numbers(
        (*POINT, "mode"),
        prestress_eigenvalue="eigenvalues of the prestress matrix at unit stress, ascending",
        principal_curvature="principal curvatures towards the stress, ascending",
    ),
    *numbers(POINT, "i1", n_negative="negative eigenvalues of the prestress matrix"),
    *outcomes(POINT, outcome="outcome at this stress"),
    *numbers((*POINT, "vertex", "axis"), position="vertex coordinates, pins first and last"),
    *numbers(
        POINT,
        position_error_bound="bound on the error of position",
        lowest_height="least height of 1000 random configurations over the tangent plane",
    ),
    *numbers((*POINT, "edge", "chart_axis"), tangents="tangents of the manifold of half squared lengths, dh/ds"),
    *numbers(
        (*POINT, "chart_axis", "chart_axis_"),
        metric="metric, products of the tangents",
        second_form="second fundamental form towards the stress",
    ),
    *numbers(("check_row",), "i4", checked_row="rows, and likewise columns, where checks were made"),
    *numbers((*CHECKED, "chart_axis", "chart_axis_"), numeric_second_form="second form by finite differences"),
    *numbers(
        CHECKED,
        "i1",
        prestress_stable="whether the self-stress, up to its sign, stabilises all zero modes",
        ways_out="number of motions that turn the first edge by 0.001 at fixed lengths",
    ),
    *numbers(("example", "edge"), example_sigma="stress of each example, none if floppy"),
    *numbers(("example", "vertex", "axis"), example_position=f"vertices of each example: {', '.join(EXAMPLES)}"),
    *numbers(("example", "frame", "vertex", "axis"), example_motion="configurations of the same lengths"),
    *numbers(("edge", "chart_axis"), basis="basis of the chart"),
    *numbers(("lattice",), lattice_square="squared lengths of a cubic lattice"),
    *numbers(
        ("lattice", "lattice_", "lattice__"),
        "i1",
        lattice_compatible="whether edges of such squared lengths can join the pins",
    ),
    *outcomes(("grid",), status="outcome of the grid"),
)


study = Study(
    name="three_bar",
    title="The critical manifold of the three-bar linkage",
    references=PAPER,
    committed=committed_run("three_bar"),
    axes=(Axis("grid", (*CHARTS, *SHEETS), "grid of stresses: of the chart, or of one sheet of the manifold"),),
    parameters={"span": 3.0, "reach": 2.4, "s": decimals("-2.1:2.1:0.1")},
    coordinates=(Coordinate("column", "s", "node of the grid: in the chart, its first coordinate"),),
    case=case,
    check=check,
    variables=VARIABLES,
    verify=verify,
    figures={"manifold": manifold_figure, "geometry": geometry_figure, "curvature": curvature_figure},
    claims=claims,
)
