"""The gallery study end to end, small: thirteen panels whose arrays bear out what the figure and the claims say."""

import matplotlib
import numpy as np

from critflow import Network, Status
from critflow.command.main import main
from critflow.engine.code_digest import load_study

matplotlib.use("Agg")

PANELS = load_study("gallery").study.axes[1].values

STUDY = "gallery"


def bond_vectors(one):
    return Network(one.edges.values, one.offsets.values, one.cell.values).bond_vectors(one.position.values)


def test_every_panel_is_there_and_found(dataset):
    assert dict(dataset.sizes) == {"panel": 13, "seed": 2, "edge": 90, "vertex": 60, "face": 30, "end": 2, "axis": 2,
                                   "cell_vector": 2}  # fmt: skip
    status = dataset.status.transpose("panel", "seed")
    slack = [panel for panel in PANELS if (status.sel(panel=panel) != Status.ok).any()]
    assert slack == ["random_lengths", "random_lengths_transition"]
    assert set(np.unique(status)) <= {Status.ok, Status.slack_edges, Status.compressed_edges}
    assert dataset.residual.max() < 1e-12
    assert {variable.attrs["units"] for variable in dataset.variables.values()} == {"1"}


def test_claims_change_their_verdict_with_the_arrays(dataset):
    claims = load_study("gallery").study.claims
    for name, panel, factor, key in (
        ("V_tau", "min_V_tau_inflated", 1 + 1e-9, "V_tau-degenerate"),
        ("B_0", "max_B_0_wave", 1 - 1e-11, "B_0-degenerate"),
        ("B_0_affine", "max_B_0", 1.01, "B_0-affine"),
        ("flat_directions", "max_B_0", 2, "B_0-flat-directions"),
    ):
        changed = dataset.copy(deep=True)
        changed[name].loc[{"panel": panel}] *= factor
        assert {claim.key: claim.verdict for claim in claims(changed)}[key] == "differs", key
    assert claims(dataset.sel(panel=["random_stress_1"])) == []


def test_a_part_of_the_panels_makes_a_figure_too(dataset):
    study = load_study("gallery").study
    part = dataset.sel(panel=["max_B_0", "random_lengths"]).copy(deep=True)
    part.sigma.loc[{"panel": "random_lengths"}] = np.nan
    part.status.loc[{"panel": "random_lengths"}] = Status.stalled
    figure = study.figures["gallery"](part)
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert len(titles) == 2 and "stalled" in titles[1]


def test_verify_finds_what_does_not_belong(folder, dataset):
    assert main(["verify", str(folder)]) == 0
    verify = load_study("gallery").study.verify
    assert verify(dataset) == []
    for name, factor in (("length", 1.001), ("tension", 1.001), ("B_0", 1.001), ("G_0", 1.01),
                         ("B_0_affine", 1.01), ("V_tau", 1.01), ("position", 1.01)):  # fmt: skip
        wrong = dataset.copy(deep=True)
        wrong[name].loc[{"panel": "max_G_0_2", "seed": 1}] *= factor
        (line,) = verify(wrong)
        assert line.startswith("panel max_G_0_2, seed 1: "), name
        assert name.replace("position", "force balance") in line
    # Another configuration in balance, but no isogonal change of D.
    wrong = dataset.copy(deep=True)
    for name, values in wrong.data_vars.items():
        if "panel" in values.dims:
            values.loc[{"panel": "max_B_0_wave"}] = dataset[name].sel(panel="random_stress_1")
    assert [line.split(":")[1].split(" does")[0] for line in verify(wrong)] == [" directions and tensions"] * 2
