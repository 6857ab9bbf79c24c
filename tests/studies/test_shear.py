"""The shear study, small: bounds, thresholds and exponents."""

import numpy as np
import pytest
import xarray as xr

from critflow import optimize, upper_bound, voronoi_network
from critflow.engine.code_digest import load_study
from critflow.quantities import pure_shear, transition_modulus
from critflow.result import Status
from workflows.shared.reports import exponent
from workflows.shear.report import crossings_of_wrapping

STUDY = "shear"


def test_the_shear_modulus_is_kept_only_where_it_is_the_objective(dataset):
    optimised = dataset.G_0.sel(population="max_G_0")
    assert (optimised > dataset.G_0.drop_sel(population="max_G_0")).all()
    assert (optimised < dataset.bound).all()
    detailed = dataset.isel(seed=slice(0, 2))
    assert (detailed.G_0_of_threshold.sel(threshold=0.1) == optimised.isel(seed=slice(0, 2))).all()
    assert (detailed.G_0_of_threshold.diff("threshold") < 0).all()
    assert (detailed.alignment_of_threshold.diff("threshold") < 0).all()
    best = optimize(voronoi_network(40, 1), "G_0", threshold=0.3, throw=False).value
    angle = np.arctan2(*best.bond_vectors.T)
    order = abs(np.average(np.sin(2 * angle), weights=best.tensions))
    assert float(dataset.alignment_of_threshold.sel(seed=1, n_vertices=40, threshold=0.3)) == pytest.approx(order)
    assert np.isnan(dataset.objective_of_start.isel(seed=2)).all()
    assert (dataset.threshold_status.isel(seed=2) == Status.missing).all()
    for n_vertices in dataset.n_vertices.values:
        expected = upper_bound(
            voronoi_network(int(n_vertices), 1), transition_modulus(voronoi_network(int(n_vertices), 1), pure_shear(2))
        )
        assert float(dataset.bound.sel(seed=1, n_vertices=n_vertices)) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize(
    "start, across, up, expected",
    [
        ((0.5, 0.6), 0.8, 0.8, (2, 1)),
        ((0.95, 0.6), 0.8, 0.8, (2, 0)),  # beside the end of the other
        ((0.3, 0.6), 1.5, 2.6, (2, 6)),  # two images across, three up
        ((0.5, 0.6), 0.8, 0.4, (1, 0)),  # the nearest image
    ],
)
def test_edges_that_wrap_around_the_box_are_counted_with_their_crossings(start, across, up, expected):
    x, y = start
    one = xr.Dataset(
        {
            "edges": (("edge", "end"), [[0, 1], [2, 3]]),
            "offsets": (("edge", "axis"), np.zeros((2, 2))),
            "cell": (("cell_vector", "axis"), 3 * np.eye(2)),
            "position": (
                ("step", "vertex", "axis"), [3 * np.array([[0.1, 0.9], [0.1 + across, 0.9], [x, y], [x, y + up]])]
            ),
        }
    )  # fmt: skip
    assert crossings_of_wrapping(one.isel(step=0)) == expected


def test_an_ascent_that_ends_early_is_measured_at_its_last_record(dataset):
    """The two statements on long edges follow the positions, of networks whose ascent was cut too."""
    claims = load_study(STUDY).study.claims
    cut, straight = dataset.copy(deep=True), dataset.copy(deep=True)
    cut["G_0_ascent"].loc[{"seed": 0, "step": slice(200, None)}] = np.nan
    straight["position"][:] = 0.0
    for changed, verdict in ((dataset, "holds"), (cut, "holds"), (straight, "differs")):
        assert {claim.key: claim.verdict for claim in claims(changed)}["wrapping"] == verdict


def test_an_exponent_is_recovered_with_its_interval():
    sizes, rng = np.array([100, 200, 500, 1000]), np.random.default_rng(4)
    inside = 0
    for _ in range(40):
        values = (sizes**-0.8)[:, None] * rng.standard_normal((4, 60)) ** 2
        fit = exponent(sizes, values)
        assert fit[1] < fit[0] < fit[2]
        inside += fit[1] <= -0.8 <= fit[2]
    # 95 % intervals: 38 of 40 are expected, 33 or fewer once in a thousand times.
    assert inside >= 34


def test_ascents_of_few_steps_or_early_ends_are_drawn(run_study, tmp_path):
    # No ascent reaches a part of the bound, and the recorded one ends before the last record.
    short = ("n_steps=2", "fractions=0.9", "ascent_vertices=4", "steps=0,1,10,100", "seeds=0:2", "n_vertices=20,40")
    dataset = run_study(STUDY, tmp_path / "out", *short, "populations=max_G_0,max_B_0", drawn=True)
    assert np.isnan(dataset.compressed_edges_of_part).all() and np.isnan(dataset.G_0_ascent.isel(step=-1)).all()
