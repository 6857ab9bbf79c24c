"""The whole critical manifold of the three-bar linkage, rigid sheets and branch points, as a surface.

The paper's `3-barlinkage` and `CriticalManifoldGeometry`.  The chart grid covers every stress up to its sign; the
other grids follow one sheet each in signed lengths r_α ∝ 1/σ_α, which add up to the span on all seven sheets.
"""

from __future__ import annotations

import numpy as np

from critflow import CriticalManifold, Status, rigidity, three_bar_linkage
from critflow.critical.curvature import StereographicChart, SurfaceGeometry, dense, unit_response
from critflow.critical.manifold import COLLAPSED
from critflow.result import StudyError
from critflow.workflow import Axis, Coordinate, Study, Variable, decimals, stable_rng

from ..shared.reports import PAPER
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
        return np.array([[chart.sigma([s_1, s_2]) for s_1 in at] for s_2 in at])
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
        "coordinates": critical.coordinates,
        "coordinates_error_bound": critical.error_bound,
    }
    if found.ok and not critical.lengths.min() > COLLAPSED * critical.lengths.mean():
        point["outcome"] = Status.edge_collapse
    if point["outcome"] is Status.ok:
        geometry = SurfaceGeometry(normal, unit_response(manifold, critical), chart.derivative(s))
        V, tangents = dense(geometry.chart), dense(geometry.tangents)
        form = -V.T @ tangents
        # The chart is conformal, VᵀV = c²1, so that the eigenvalues of the second form over c² are the radii.
        radii = np.linalg.eigvalsh((form + form.T) / 2) * (1 + s @ s / 4) ** 2
        point |= {
            "tangents": tangents,
            "metric": tangents.T @ tangents,
            "second_form": form,
            "principal_curvature": np.sort(1 / radii),
        }
    else:
        shapes = {"tangents": (3, 2), "metric": (2, 2), "second_form": (2, 2), "principal_curvature": (2,)}
        point |= {name: np.full(shape, np.nan) for name, shape in shapes.items()}
    return point


def check_at(manifold, chart, point):
    """Checks at one stress: finite differences of h, rescaled stress, finite motions."""
    s = point["s"]
    sigma, span = chart.sigma(s), manifold.network.pins[3][0]

    def h(a, b):
        return manifold.configuration(chart.sigma(s + np.array([a, b]))).lengths ** 2 / 2

    # The distance to the nearest place without a tangent plane sets the length on which the surface changes.
    e = 2e-3 * min(float(np.abs(sigma).min()), float(np.abs(point["prestress_eigenvalue"]).min()))
    first = np.stack([(8 * (h(e, 0) - h(-e, 0)) - h(2 * e, 0) + h(-2 * e, 0)) / (12 * e),
                      (8 * (h(0, e) - h(0, -e)) - h(0, 2 * e) + h(0, -2 * e)) / (12 * e)], axis=1)  # fmt: skip
    middle = 2 * h(0, 0)
    mixed = sigma @ (h(e, e) - h(e, -e) - h(-e, e) + h(-e, -e)) / 4
    second = np.array([[sigma @ (h(e, 0) + h(-e, 0) - middle), mixed],
                       [mixed, sigma @ (h(0, e) + h(0, -e) - middle)]]) / e**2  # fmt: skip
    rescaled = manifold.configuration(-3.0 * sigma)
    counts = rigidity(manifold.network, point["coordinates"]).value
    x = point["coordinates"][:, 0]
    return {
        "numeric_metric": first.T @ first,
        "numeric_second_form": second,
        "rescaled_change": np.abs(rescaled.coordinates - point["coordinates"]).max(),
        "rank": np.linalg.matrix_rank(point["tangents"], 1e-10 * np.abs(point["tangents"]).max()),
        "n_self_stresses": counts.n_self_stresses,
        "prestress_stable": bool(counts.prestress_stable),
        "ways_out": len(finite_motions(np.diff(x), span, 1e-3)),
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
    out = {name: [] for name in ("sigma", "coordinates", "n_self_stresses", "n_zero_modes", "motion")}
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
        counts = rigidity(manifold.network, x).value
        motion = np.full((8, 4, 2), np.nan)
        for stored, frame in zip(motion, frames, strict=False):
            stored[:] = pins[0], *frame, pins[1]
        for key, value in zip(out, (sigma, x, counts.n_self_stresses, counts.n_zero_modes, motion), strict=True):
            out[key].append(value)
    return {f"example_{key}": np.array(value) for key, value in out.items()}


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
    result = gathered(points)
    # Heights of random configurations over each tangent plane: none is below a rigid one.
    free = span * stable_rng(0, "configurations").normal(0.5, 1.0, (1000, 2, 2))
    x = np.concatenate([np.zeros((1000, 1, 2)), free, np.tile([span, 0.0], (1000, 1, 1))], axis=1)
    h = np.sum(np.diff(x, axis=1) ** 2, axis=2) / 2
    normal, here = result["normal"], result["length"] ** 2 / 2
    result["lowest_height"] = np.array([(h @ n).min() for n in normal.reshape(-1, 3)]).reshape(normal.shape[:2])
    result["lowest_height"] -= np.sum(normal * here, axis=-1)
    chosen = range(STRIDE // 2, len(nodes), STRIDE)
    empty = {"numeric_metric": np.full((2, 2), np.nan), "numeric_second_form": np.full((2, 2), np.nan),
             "rescaled_change": np.nan, "rank": 0, "n_self_stresses": 0, "prestress_stable": False,
             "ways_out": 0}  # fmt: skip
    checked = [[points[row][column] for column in chosen] for row in chosen]
    checks = [[check_at(manifold, chart, p) if p["outcome"] is Status.ok else empty for p in row] for row in checked]
    squares = (span * np.linspace(0.03, 2.4, 24)) ** 2
    return {
        "status": Status.ok,
        **result,
        **gathered(checks),
        **examples(manifold),
        "checked_row": chosen,
        "basis": dense(chart.basis),
        "lattice_square": squares,
        "lattice_compatible": compatible(span, squares).astype(int),
    }


def gathered(points):
    """Rows of dicts to one dict of arrays."""
    return {name: np.array([[point[name] for point in row] for row in points]) for name in points[0][0]}


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    if not parameters["span"] > 0:
        raise StudyError(f"span={parameters['span']} must be positive")
    if not parameters["reach"] > 1:
        raise StudyError(f"reach={parameters['reach']} must be more than 1: lengths are followed up to that many spans")
    if len(parameters["s"]) < 2 * STRIDE:
        raise StudyError(f"s needs at least {2 * STRIDE} values: s=-2.1:2.1:0.1 covers every stress")


def table():
    """Names, dimensions, types, units and meanings of the stored variables."""
    point, check_point = ("grid", "row", "column"), ("grid", "check_row", "check_column")

    def at(name, dims, long_name, dtype="f8", **more):
        return Variable(name, (*point, *dims), dtype, long_name=long_name, **more)

    def checked(name, dims, long_name, dtype="f8", **more):
        return Variable(name, (*check_point, *dims), dtype, long_name=long_name, **more)

    yield at("s", ("chart_axis",), "stereographic coordinates about equal stresses")
    yield at("sigma", ("edge",), "geometric stress (tension per length), sum of squares N_b")
    yield at("normal", ("edge",), "stress of unit norm, normal to the manifold")
    yield at("prestress_eigenvalue", ("mode",), "eigenvalues of the prestress matrix at unit stress, ascending")
    yield at("n_negative", (), "negative eigenvalues of the prestress matrix", "i1")
    yield at("outcome", (), "outcome at this stress", "i1", flags=Status)
    yield at("length", ("edge",), "edge length")
    yield at("coordinates", ("vertex", "axis"), "vertex coordinates, pins first and last")
    yield at("coordinates_error_bound", (), "bound on the error of coordinates")
    yield at("tangents", ("edge", "chart_axis"), "tangents of the manifold of half squared lengths, dh/ds")
    yield at("metric", ("chart_axis", "chart_axis_"), "metric, products of the tangents")
    yield at("second_form", ("chart_axis", "chart_axis_"), "second fundamental form towards the stress")
    yield at("principal_curvature", ("mode",), "principal curvatures towards the stress, ascending")
    yield at("lowest_height", (), "least height of 1000 random configurations over the tangent plane")
    yield Variable("checked_row", ("check_row",), "i4", long_name="rows, and likewise columns, where checks were made")
    yield checked("numeric_metric", ("chart_axis", "chart_axis_"), "metric by finite differences")
    yield checked("numeric_second_form", ("chart_axis", "chart_axis_"), "second form by finite differences")
    yield checked("rescaled_change", (), "largest move of a vertex when the stress is multiplied by -3")
    yield checked("rank", (), "rank of the tangents", "i1")
    yield checked("n_self_stresses", (), "self-stresses, counted by the rigidity matrix", "i1")
    yield checked("prestress_stable", (), "whether the self-stress, up to its sign, stabilises all zero modes", "i1")
    yield checked("ways_out", (), "number of motions that turn the first edge by 0.001 at fixed lengths", "i1")
    yield Variable("example_sigma", ("example", "edge"), "f8", long_name="stress of each example, none if floppy")
    yield Variable(
        "example_coordinates", ("example", "vertex", "axis"), "f8", long_name="vertices of each example: "
        + ", ".join(EXAMPLES),
    )  # fmt: skip
    yield Variable("example_n_self_stresses", ("example",), "i1", long_name="self-stresses of each example")
    yield Variable("example_n_zero_modes", ("example",), "i1", long_name="zero modes of each example")
    yield Variable(
        "example_motion", ("example", "frame", "vertex", "axis"), "f8", long_name="configurations of the same lengths"
    )
    yield Variable("basis", ("edge", "chart_axis"), "f8", long_name="basis of the chart")
    yield Variable("lattice_square", ("lattice",), "f8", long_name="squared lengths of a cubic lattice")
    yield Variable(
        "lattice_compatible", ("lattice", "lattice_", "lattice__"), "i1",
        long_name="whether edges of such squared lengths can join the pins",
    )  # fmt: skip
    yield Variable("status", ("grid",), "i1", long_name="outcome of the grid", flags=Status)


study = Study(
    name="three_bar",
    title="The critical manifold of the three-bar linkage",
    references=PAPER,
    axes=(Axis("grid", (*CHARTS, *SHEETS), "grid of stresses: of the chart, or of one sheet of the manifold"),),
    parameters={"span": 3.0, "reach": 2.4, "s": decimals("-2.1:2.1:0.1")},
    coordinates=(Coordinate("column", "s", "node of the grid: in the chart, its first coordinate"),),
    case=case,
    check=check,
    variables=tuple(table()),
    verify=verify,
    figures={"manifold": manifold_figure, "geometry": geometry_figure, "curvature": curvature_figure},
    claims=claims,
)
