"""The ensemble study end to end, small: what it stores, whether the stored arrays bear out the stored numbers."""

import numpy as np
import pytest

from critflow import CriticalManifold, Status, critical_from_lengths, voronoi_network
from critflow.command.main import main
from critflow.engine import stable_rng
from critflow.engine.code_digest import load_study
from workflows.benchmarks import reference
from workflows.ensemble import example_of, structure_figure
from workflows.paper.statements import STATEMENTS
from workflows.shared.measurements import BOUNDED
from workflows.shared.populations import LABELS

STUDY = "ensemble"
# The population in which every small network has slack edges; the same rest lengths in the printed box compress some.
SLACK, COMPRESSED = "random_lengths_transition", "random_lengths"


def test_every_population_was_found(dataset):
    for population in dataset.population.values:
        statuses = dataset.status.sel(population=population)
        if population == COMPRESSED:
            sigma = dataset.sigma.sel(population=population)
            compressed = (sigma < 0).any("edge").values
            assert (sigma != 0).all() and compressed.any()
            np.testing.assert_array_equal(statuses, np.where(compressed, Status.compressed_edges, Status.ok))
        else:
            assert (statuses == (Status.slack_edges if population == SLACK else Status.ok)).all(), population
    assert (dataset.valid == 1).all()


def test_stressed_edges_have_any_sign_and_those_under_tension_one(dataset):
    """Of the two, rigidity percolation is of the stressed ones: in the printed box every edge of these networks is."""
    sigma = dataset.sigma
    np.testing.assert_allclose(dataset.stressed_fraction, (abs(sigma) > 1e-8).mean("edge"), rtol=0, atol=1e-15)
    np.testing.assert_allclose(dataset.tension_fraction, (sigma > 1e-8).mean("edge"), rtol=0, atol=1e-15)
    (claim,) = (one for one in load_study(STUDY).study.claims(dataset) if one.key == "full-percolation")
    assert claim.verdict == "undecided" and [row["verdict"] for row in claim.rows] == ["holds", "differs"]
    assert (dataset.tension_fraction.sel(population=COMPRESSED) < 1).any()


def test_the_file_alone_says_what_its_numbers_are(dataset):
    """The definitions of both random populations, the units, the strain, the shapes, labels and errors."""
    summary = dataset.attrs["summary"]
    for words in ("random_lengths ", "random_lengths_transition ", "√(V/N_v)", "V = V(0) (1 + γ)", "F = 1 + ε A"):
        assert words in summary, words
    assert "..." not in summary
    assert "valid members: ds[['B_0', 'G_0']].where(ds.valid)" in summary
    labels = {"end": ["tail", "head"], "axis": ["x", "y"], "cell_vector": ["a", "b"]}
    assert {name: dataset[name].values.tolist() for name in labels} == labels
    assert dataset.C_B_fit.attrs["ancillary_variables"] == "C_B_fit_standard_error"
    for name, words in (("kappa_phys", "κ = "), ("kappa_force", "κ = "), ("B_0", "state: "), ("length", "state: ")):
        assert words in dataset[name].attrs["comment"], name
    for name, words in (("length", "(V/N_v)^(1/2)"), ("position", "(V/N_v)^(1/2)"), ("energy", "k V/N_v")):
        assert words in dataset[name].attrs["long_name"], name


def test_the_stored_rest_lengths_give_both_random_configurations_again(dataset):
    network = voronoi_network(60, seed=0)
    drawn = dataset.rest_length.sel(seed=0)
    transition, box = (drawn.sel(population=p).values for p in (SLACK, COMPRESSED))
    np.testing.assert_array_equal(transition, box)
    again = critical_from_lengths(network, transition, throw=False).value.sigma
    np.testing.assert_allclose(again, dataset.sigma.sel(seed=0, population=SLACK), rtol=0, atol=1e-9)
    one = dataset.sel(seed=0, population=COMPRESSED)
    sigma = 1 - box * np.sqrt(network.volume / network.n_edges) / one.length.values
    sigma *= np.sqrt(network.n_edges / np.sum(sigma**2))
    np.testing.assert_allclose(sigma, one.sigma, rtol=0, atol=1e-9)
    assert np.isnan(drawn.drop_sel(population=[SLACK, COMPRESSED])).all()


def test_coefficients_are_undefined_where_an_edge_collapses(run_study, tmp_path):
    """The moduli of the limit are sound."""
    small = ("n_vertices=12", "seeds=18:19", "populations=min_V_tau,max_B_0", "strains=0.001,0.002,0.003,0.004")
    collapsed, other = (
        run_study(STUDY, tmp_path, *small).isel(seed=0).sel(population=p) for p in ("min_V_tau", "max_B_0")
    )
    assert (collapsed.status, collapsed.valid) == (Status.edge_collapse, 1)
    for coefficient in ("C_B", "C_G", "C_G_stress_corrected"):
        for name in (
            f"{coefficient}{end}" for end in ("", "_error_bound", "_fit", "_fit_standard_error", "_fit_deviation")
        ):
            assert np.isnan(collapsed[name]) and np.isfinite(other[name]), name
    assert np.isfinite(collapsed.B_0) and np.isfinite(collapsed.B).all()


def test_several_taut_parts_add_up(run_study, tmp_path):
    dataset = run_study("ensemble", tmp_path / "out", "n_vertices=4", "seeds=0", "populations=random_lengths")
    one = dataset.isel(seed=0, population=0)
    assert Status(int(one.status)) is Status.slack_edges and (one.path_status == Status.ok).all()
    # Two chains around the cell, of which each has B = ⅛ k; the fitted line misses the curvature.
    assert (float(one.B_0), float(one.C_B)) == pytest.approx((0.25, -0.125), rel=1e-12)
    assert float(one.C_B_fit) == pytest.approx(float(one.C_B), rel=0.02)
    assert not load_study("ensemble").study.verify(dataset)


def test_populations_have_labels_symbols_and_colours(dataset):
    labels = dict(zip(dataset.population.values, dataset.population_label.values, strict=True))
    assert labels["min_V_tau"] == "min V_τ" and labels["random_lengths"] == "random ℓ"
    assert dataset.population_symbol.sel(population="max_B_0").item() == "max $B_0$"
    assert len(set(dataset.population_color.values)) == dataset.sizes["population"]


def test_the_networks_are_those_that_users_get(dataset):
    for seed in dataset.seed.values:
        network = voronoi_network(60, seed=int(seed))
        np.testing.assert_array_equal(dataset.edges.sel(seed=seed), network.edges)
        best = CriticalManifold(network).configuration(np.ones(network.n_edges))
        stored = dataset.position.sel(seed=seed, population="max_B_0")
        np.testing.assert_allclose(stored, best.coordinates, rtol=0, atol=1e-12)


def test_random_populations_do_not_depend_on_other_populations(dataset, run_study, tmp_path):
    alone = run_study(STUDY, tmp_path, "seeds=2", "populations=random_lengths,random_stress")
    for population in ("random_lengths", "random_stress"):
        one, other = (ds.sel(seed=2, population=population) for ds in (alone, dataset))
        np.testing.assert_array_equal(one.sigma, other.sigma)
        np.testing.assert_array_equal(one.B, other.B)


def test_the_statements_of_the_paper_follow_the_arrays(dataset):
    """The same verdicts at any size, and others where the arrays are others."""
    claims = load_study(STUDY).study.claims
    expected = [known.id for known in STATEMENTS.values() if known.study == STUDY]
    assert [claim.key for claim in claims(dataset)] == expected
    verdicts = {claim.key: claim.verdict for claim in claims(dataset)}
    # Signs and order of other populations need larger networks.
    assert {verdicts[name] for name in ("equal-lengths", "B_0-order", "linear-growth", "G_0-gain")} == {"holds"}
    for name, population, factor, key in (
        ("stressed_fraction", "random_lengths", 0.5, "full-percolation"),
        ("V_L", "min_V_L", 1e30, "equal-lengths"),
        ("V_tau", "min_V_tau", 2, "least-V_tau"),
        ("B_0", "min_V_tau", 0.5, "B_0-order"),
        ("B_0", "random_stress", 10, "B_0-over-random_stress"),
        ("C_B_fit", "max_B_0", -1, "C_B-signs"),
        ("C_G_stress_corrected_fit", "max_G_0", -100, "opposed-ranks"),
        ("length", "min_V_tau", 0.1, "fracture"),
        ("B", "max_B_0", 1.01, "linear-growth"),
        ("kappa_force", "max_G_0", 0.5, "kappa-force"),
        ("kappa_force", "max_G_0", 0.01, "regular-forces"),
        ("G_0", "max_G_0", 1e-3, "G_0-gain"),
    ):
        changed = dataset.copy(deep=True)
        changed[name].loc[{"population": population}] *= factor
        assert {claim.key: claim.verdict for claim in claims(changed)}[key] == "differs", key


def test_titles_of_figures_state_what_the_data_show(dataset):
    """A finding where it holds, and the subject alone where other data do not show it."""
    figure = structure_figure(dataset)
    changed = dataset.copy(deep=True)
    changed["kappa_force"].loc[{"population": "max_G_0"}] *= 0.5
    assert "only max $G_0$" in figure.get_suptitle()
    assert structure_figure(changed).get_suptitle().startswith("Structure of")
    (lengths,) = (axes for axes in figure.axes if axes.get_title("left") == "A")
    assert lengths.get_yticklabels()[0].get_text() == "0"  # V_L = 0 stands below the break of the axis


def test_the_drawn_network_is_of_the_population_with_the_extreme_median(dataset):
    for name, word, population in (("V_L", "least", "min_V_L"), ("B_0", "largest", "max_B_0")):
        one, caption = example_of(dataset, name, word)
        assert one.population.item() == population and LABELS[population] in caption


def test_the_scatter_about_a_line_is_no_error_and_the_error_bar_of_a_parabola_contains_the_coefficient(
    dataset, run_study, tmp_path
):
    parabola = run_study(STUDY, tmp_path, "fit_degree=2", "variables=scalars")
    assert {str(p) for p in parabola.population.values} == {str(p) for p in dataset.population.values}
    for name in ("C_B", "C_G", "C_G_stress_corrected"):
        for ds in (dataset, parabola):
            np.testing.assert_array_equal(ds[f"{name}_fit_deviation"], ds[f"{name}_fit"] - ds[name])
        defined = np.isfinite(parabola[name].values)
        assert defined.sum() >= 20
        off, bar = (parabola[f"{name}_fit{part}"].values[defined] for part in ("_deviation", "_standard_error"))
        assert (np.abs(off) < bar).all()
        assert np.median(np.abs(off)) < 0.2 * np.median(np.abs(dataset[f"{name}_fit_deviation"].values[defined]))
        line = dataset[f"{name}_fit_deviation"] / dataset[f"{name}_fit_standard_error"]
        assert 10 < np.abs(line).median() < 16


def test_what_is_not_unique_says_so(dataset):
    for name in ("sigma", "position", "length", "C_B"):
        assert "isogonal" in dataset[name].attrs["comment"]
    assert "isogonal" not in dataset.B_0.attrs["comment"]


def test_show_draws_a_case_and_prints_its_status_and_moduli(dataset, folder, tmp_path, capsys, assert_picture):
    picture = tmp_path / "one.png"
    words = ["--set", "seed=1", "--set", "population=max_B_0", "--out", str(picture)]
    assert main(["show", str(folder / "ensemble.nc"), *words]) == 0
    text = capsys.readouterr().out
    stiffest = dataset.B_0.sel(seed=1, population="max_B_0").item()
    assert "population max_B_0: ok, converged" in text and f"B_0 = {stiffest:.6g} k" in text
    assert_picture(picture)


def test_stored_numbers_are_within_their_error_bounds(run_study, tmp_path):
    """Against mpmath; the bounds are a few roundings, and ancillary variables after CF."""
    populations = ("max_B_0", "random_stress", "max_G_0")
    dataset = run_study(STUDY, tmp_path, "seeds=0", "n_vertices=24", f"populations={','.join(populations)}")
    for name in BOUNDED:
        assert dataset[name].attrs["ancillary_variables"] == f"{name}_error_bound"
    network = voronoi_network(24, seed=0)
    for population in populations:
        one = dataset.sel(population=population, seed=0)
        exact = reference.stiffening(network, reference.configuration(network, one.sigma.values))
        names = ("B_0", "G_0", "C_B", "C_G")
        for name, truth in zip(names, exact, strict=False):
            bound = float(one[f"{name}_error_bound"])
            assert abs(reference.MP.mpf(float(one[name])) - truth) <= bound < 1e-13, (population, name)
    raw = np.abs(stable_rng(0, "random_stress").standard_normal(network.n_edges))
    one, exact = dataset.sel(population="random_stress", seed=0), reference.configuration(network, raw)
    error = reference.largest_error(one.position.values, exact.coordinates, moved=True)
    assert error <= float(one.position_error_bound) < 1e-14


def test_the_selection_of_the_documents_keeps_integers_and_sound_cases(dataset):
    masked = dataset[["B_0", "C_B"]].where(dataset.valid)
    assert np.isfinite(masked.B_0).all() and set(masked.dims) == {"population", "seed"}
    wrong = dataset.copy()
    wrong["valid"] = dataset.valid.where(dataset.seed != 1, 0)
    assert np.isnan(dataset[["B_0"]].where(wrong.valid).B_0.sel(seed=1)).all()
