"""How the boundary of a periodic network enters: L = g x + b, with b fixed by the cell images that edges join.

The paper's `BoundaryTerm`, and its affine deformation b → F b up to shears at which nearest images are wrong.
"""

from itertools import product

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from critflow import CriticalManifold, Status, voronoi_network
from critflow.engine import Claim, Coordinate, Study, decimals, stable_rng
from critflow.pictures import COLOURS

from .shared.checks import voronoi_check
from .shared.reports import PAPER, minus
from .shared.tables import NETWORK, PLANE, networks, numbers, of_network, outcomes
from .shared.verification import bond_vectors, contradictions, forces


def nearest_images(coordinates, edges, cell):
    """The shortest vector from tail to head (N_b, 2) among all images of the head, without the offsets."""
    apart = coordinates[edges[:, 1]] - coordinates[edges[:, 0]]
    # Under shear the nearest image may lie several sheared cells away.
    reach = range(-6, 7)
    images = np.array([apart + image @ cell for image in product(reach, reach)])
    return np.take_along_axis(images, np.linalg.norm(images, axis=2).argmin(axis=0)[None, :, None], axis=0)[0]


def case(parameters, *, seed):
    """One network: boundary term, configuration at a random stress, and configurations with the boundary sheared."""
    network = voronoi_network(parameters["n_vertices"], seed)
    sigma = np.abs(stable_rng(seed, "boundary").standard_normal(network.n_edges))
    critical = CriticalManifold(network).configuration(sigma)
    sheared, cells, wrong = [], [], []
    for shear in parameters["shears"]:
        deformed = network.deformed([[1.0, shear], [0.0, 1.0]])
        solved = CriticalManifold(deformed).configuration(sigma)
        nearest = nearest_images(solved.coordinates, network.edges, deformed.cell)
        sheared.append(solved)
        cells.append(deformed.cell)
        wrong.append(np.count_nonzero(np.abs(nearest - solved.bond_vectors).max(axis=1) > 1e-9))
    return {
        "status": Status.ok,
        **of_network(network),
        "boundary_vectors": network.boundary_vectors,
        "positions": network.positions,
        "sigma": critical.sigma,
        "position": critical.coordinates,
        "position_error_bound": critical.error_bound,
        "bond_vectors": critical.bond_vectors,
        "sheared_cell": cells,
        "sheared_bond_vectors": [solved.bond_vectors for solved in sheared],
        "sheared_boundary_vectors": [solved.network.boundary_vectors for solved in sheared],
        "nearest_image_wrong": wrong,
    }


SHEARED = ("seed", "shear")
VARIABLES = (
    *NETWORK,
    *numbers(("seed", "edge"), sigma="geometric stress, sum of squares N_b"),
    *numbers(
        ("seed", "vertex", "axis"),
        positions="vertices of the tessellation",
        position="vertex coordinates under that stress",
    ),
    *numbers(
        ("seed", "edge", "axis"),
        boundary_vectors="boundary term b of each edge",
        bond_vectors="bond vectors under that stress",
    ),
    *numbers(("seed",), position_error_bound="bound on the error of position"),
    *numbers((*SHEARED, "cell_vector", "axis"), sheared_cell="cell vectors as rows after the shear"),
    *numbers(
        (*SHEARED, "edge", "axis"),
        sheared_bond_vectors="bond vectors after the shear",
        sheared_boundary_vectors="boundary term after the shear",
    ),
    *numbers(SHEARED, "i4", nearest_image_wrong="edges whose ends are nearer in another image"),
    *outcomes(("seed",), status="outcome"),
)


INTERIOR, CROSSING = COLOURS[1], COLOURS[0]
COPY_INTERIOR, COPY_CROSSING = "#B7E0C0", "#1B7837"


def boundary_figure(ds):
    """`BoundaryTerm`: a network among its copies, all its vertices at one point, and both sheared."""
    one = ds.isel(seed=0)
    # The largest shear that is still easy to read.
    deformed = one.isel(shear=int(np.argmin(np.abs(ds.shear.values - 0.5))))
    figure = Figure(figsize=(9.6, 10.0), dpi=120, layout="constrained")
    axes = figure.subplots(2, 2)
    plain, sheared = one.cell.values, deformed.sheared_cell.values
    F = np.linalg.solve(plain, sheared)
    for row, (cell, positions, b, name) in enumerate(
        (
            (plain, one.positions.values, one.boundary_vectors.values, ""),
            (sheared, one.positions.values @ F, deformed.sheared_boundary_vectors.values, "sheared, b → F b:  "),
        )
    ):
        _draw_copies(axes[row, 0], one, cell, positions)
        _draw_collapsed(axes[row, 1], one, cell, b)
        axes[row, 0].set_title(f"$\\bf{{{'AC'[row]}}}$   {name}L = g x + b", loc="left", fontsize=11)
        axes[row, 1].set_title(
            f"$\\bf{{{'BD'[row]}}}$   {name}all vertices at one point, L = b", loc="left", fontsize=11
        )
    handles = [
        axes[0, 0].plot([], [], color=colour, linewidth=2.4, label=label)[0]
        for colour, label in (
            (INTERIOR, "edges within the cell, b = 0"),
            (COPY_INTERIOR, "copies of the former"),
            (CROSSING, "edges across its boundary, b ≠ 0"),
            (COPY_CROSSING, "copies of the latter"),
        )
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=10, frameon=False)
    return figure


def _draw_copies(axes, one, cell, positions):
    tail = positions[one.edges.values[:, 0]]
    head = positions[one.edges.values[:, 1]] + one.offsets.values @ cell
    segments, crosses = np.stack([tail, head], axis=1), one.offsets.values.any(axis=1)
    for image in product((-2, -1, 0, 1, 2), repeat=2):
        here = image == (0, 0)
        width, order = (2.4, 3) if here else (1.3, 2)
        for which, colour in (
            (~crosses, INTERIOR if here else COPY_INTERIOR),
            (crosses, CROSSING if here else COPY_CROSSING),
        ):
            ends, style = segments[which] + np.array(image) @ cell, {"colors": colour, "capstyle": "round"}
            axes.add_collection(LineCollection(ends, linewidths=width, zorder=order, **style))
    axes.plot(*positions.T, "o", color="k", markersize=3.6, zorder=4)
    _window(axes, cell)


def _draw_collapsed(axes, one, cell, b):
    """The edges with every vertex in the middle of its cell, and the number of edges of each b."""
    middle = cell.sum(axis=0) / 2
    points = np.array([middle + np.array(image) @ cell for image in product((-2, -1, 0, 1, 2), repeat=2)])
    images, counts = np.unique(one.offsets.values, axis=0, return_counts=True)
    joins = images[images.any(axis=1)]
    lines = [[point, point + join @ cell] for point in points for join in joins]
    axes.add_collection(LineCollection(lines, colors=COPY_CROSSING, linewidths=1.2, zorder=2))
    axes.plot(*points.T, "o", color=COPY_CROSSING, markersize=5, zorder=3)
    box = {"boxstyle": "round,pad=0.2", "facecolor": "w", "edgecolor": "none", "alpha": 0.9}
    for image, count in zip(images, counts, strict=True):
        if not image.any():
            axes.plot(*middle, "o", color="k", markersize=9, zorder=5)
            place = middle + 0.24 * cell[0] - 0.17 * cell[1]
            axes.annotate(
                f"{count} edges\nwith b = 0", middle, place, fontsize=9, ha="center", va="center", color=INTERIOR,
                fontweight="bold", bbox=box, zorder=6,
            )  # fmt: skip
            continue
        b_of = b[(one.offsets.values == image).all(axis=1)][0]
        axes.annotate(
            "", middle + b_of, middle, zorder=4,
            arrowprops={"arrowstyle": "-|>", "color": CROSSING, "linewidth": 2.4, "shrinkA": 0, "shrinkB": 3},
        )  # fmt: skip
        name = minus(f"({image[0]:d}, {image[1]:d})")
        axes.text(
            *(middle + 0.7 * b_of), f"{name}\n{count} edge{'s' if count > 1 else ''}",
            fontsize=8.5, ha="center", va="center", color=CROSSING, bbox=box, zorder=6,
        )  # fmt: skip
    _window(axes, cell)


def _window(axes, cell):
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) @ cell
    axes.add_patch(
        Polygon(corners, closed=True, fill=False, edgecolor="0.35", linewidth=1.0, linestyle=(0, (4, 2)), zorder=5)
    )
    middle, half = cell.sum(axis=0) / 2, 1.12 * np.abs(cell).max()
    axes.set(
        xlim=(middle[0] - half, middle[0] + half),
        ylim=(middle[1] - half, middle[1] + half),
        aspect="equal",
        xticks=[],
        yticks=[],
    )
    axes.spines[:].set_color("0.8")


# Claims


def claims(ds):
    """The images that a search for the nearest one takes."""
    wrong, total = ds.nearest_image_wrong.sum("seed").values, ds.sizes["seed"] * ds.sizes["edge"]
    listed = ", ".join(f"{100 * n / total:.3g} % at {shear:g}" for n, shear in zip(wrong, ds.shear.values, strict=True))
    return [
        Claim.tested(
            "nearest-image", "taking the nearest image in place of the stored one would miss edges", "",
            f"shear by shear {listed}", bool(wrong[-1] > 0), "none is missed at these shears",
            criterion="some at the largest shear",
        ),
    ]  # fmt: skip


def verify(ds):
    """A line for each network whose bond vectors, force balance or sheared boundary contradict its arrays."""
    return contradictions(ds, ("seed",), _checks)


def _checks(one):
    b, sigma, L = one.boundary_vectors.values, one.sigma.values, bond_vectors(one)
    yield "sigma", np.isclose(np.sum(sigma**2), len(sigma), rtol=1e-10)
    yield "boundary_vectors", np.allclose(b, one.offsets.values @ one.cell.values, rtol=0, atol=1e-12)
    yield "bond_vectors", np.allclose(L, one.bond_vectors, rtol=0, atol=1e-12)
    yield "force balance", np.abs(forces(one, L)).max() <= 1e-11 * np.abs(sigma[:, None] * L).mean()
    for shear in one.shear.values:
        F = np.array([[1.0, shear], [0.0, 1.0]])
        sheared = one.sheared_bond_vectors.sel(shear=shear)
        yield f"sheared_cell at {shear:g}", np.allclose(one.cell.values @ F.T, one.sheared_cell.sel(shear=shear))
        yield f"sheared_bond_vectors at {shear:g}", np.allclose(L @ F.T, sheared, rtol=0, atol=1e-10)


study = Study(
    name="boundary",
    title="The boundary term of a periodic network",
    references=PAPER,
    axes=(networks(10),),
    parameters={"n_vertices": 30, "shears": decimals("0:2:0.5")},
    coordinates=(Coordinate("shear", "shears", "simple shear of the boundary"), *PLANE),
    case=case,
    check=voronoi_check(),
    variables=VARIABLES,
    verify=verify,
    figures={"boundary": boundary_figure},
    claims=claims,
)
