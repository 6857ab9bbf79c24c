"""The failure map: its references against dense numpy, its outcomes of fabricated answers, and the study, small."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from critflow import InputError, Status
from critflow.command.main import main
from critflow.engine.code_digest import load_study
from workflows.benchmarks.failure_map import peers, problems, quantities, report
from workflows.benchmarks.failure_map.outcomes import Answer, Outcome, Violation, assessed, compared
from workflows.benchmarks.reference import Unknown

STUDY = load_study("failure_map").study


# Outcomes


def answer(values=(1.0,), bounds=np.nan, status=Status.ok):
    return lambda: Answer(status, values, bounds)


def off(error, scale=1.0):
    return lambda _: (error, scale)


def raising(error):
    def call(*_):
        raise error

    return call


def warning():
    warnings.warn("careful", RuntimeWarning, stacklevel=1)
    return answer()()


@pytest.mark.parametrize(
    "compute, compare, outcome, violation",
    [
        (answer(bounds=1e-15), off(1e-16), Outcome.exact, Violation.none),
        (answer(bounds=1e-5), off(1e-6), Outcome.bounded, Violation.none),
        (answer(), off(1e-10), Outcome.tolerated, Violation.none),
        (answer(), off(1e-6, 1e4), Outcome.tolerated, Violation.none),
        (answer(status=Status.singular, values=(np.nan,)), off(1.0), Outcome.reported, Violation.none),
        (raising(InputError("no")), off(0.0), Outcome.refused, Violation.none),
        (answer(), raising(Unknown("no")), Outcome.unknown, Violation.none),
        (answer(bounds=1e-16), off(2e-16), Outcome.violation, Violation.above_bound),
        (answer(bounds=0.0), off(1.0), Outcome.violation, Violation.above_bound),
        (answer(values=(1.0, 2.0), bounds=(1.0, 1e-9)), off([0.5, 1e-8]), Outcome.violation, Violation.above_bound),
        (answer(), off(1e-6), Outcome.violation, Violation.above_tolerance),
        (answer(), off(np.inf), Outcome.violation, Violation.above_tolerance),
        (answer(values=(np.nan,)), off(0.0), Outcome.violation, Violation.not_finite),
        (warning, off(0.0), Outcome.violation, Violation.warning),
        (raising(ZeroDivisionError("no")), off(0.0), Outcome.violation, Violation.exception),
    ],
)
def test_every_kind_of_answer_is_assessed(compute, compare, outcome, violation):
    found = assessed(compute, compare)
    assert (found.outcome, found.violation) == (outcome, violation)


def test_of_several_numbers_the_one_nearest_to_its_bound_is_kept():
    found = compared([1e-6, 1e-8], [1e-3, 2e-8], 2.0)
    assert (found.error, found.bound) == (0.5e-8, 1e-8)


# The problems


def test_the_prestress_matrix_is_singular_where_it_is_said_to_be():
    difficulty = problems.DIFFICULTIES["near_singular"]
    least = []
    for strength in (1e-3, 0.0, -1e-3):
        problem = difficulty.problem(strength, 0, 12)
        g = problem.network.free_incidence.toarray()
        least.append(np.linalg.eigvalsh(g.T @ (problem.sigma[:, None] * g))[0])
    assert least[0] > 1e-6
    assert abs(least[1]) < 1e-13
    assert least[2] < -1e-6


@pytest.fixture
def pretend(monkeypatch):
    """`pretend(name, **options)`: this function of the library, with other options, has the status ok."""

    def of(name, **options):
        real = getattr(quantities.cf, name)
        certain = lambda *given, **more: replace(real(*given, **more | options), status=Status.ok)  # noqa: E731
        monkeypatch.setattr(quantities.cf, name, certain)

    return of


def test_a_point_that_is_no_optimum_is_a_violation(pretend):
    problem = problems.DIFFICULTIES["threshold"].problem(0.5, 1, 16)
    pretend("optimize", tolerance=1e-3)
    found = quantities.finding("max_G_0_lbfgs", problem)
    assert found.violation is Violation.above_tolerance
    assert found.error < 0.1


# The study


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("failures")
    settings = (
        "difficulties=near_singular,small_strain,extra_edges,stress_spread", "seeds=0:1", "n_vertices=12",
        "n_steps=4", "quantities=configuration,transition_moduli,rigidity,equilibrium_newton,max_G_0_auto,FIRE,"
        "LAMMPS cg,matscipy",
    )  # fmt: skip
    words = [word for setting in settings for word in ("--set", setting)]
    assert main(["run", "failure_map", "--workers", "0", "--out", str(folder), *words]) == 0
    with xr.open_dataset(folder / "failure_map.nc") as dataset:
        return dataset.load(), folder


def test_the_study_writes_its_figures_and_claims(small, assert_picture):
    dataset, folder = small
    for name in (*report.MAPS, "error_bounds"):
        assert_picture(folder / "figures" / f"{name}.png")
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    ours = dataset.outcome.isel(quantity=~np.isin(dataset["quantity"].values, peers.PEERS))
    wrong = int((ours == Outcome.violation).sum())
    assert claims["violations"]["value"].startswith(f"{wrong} of ")
    assert claims["violations"]["verdict"] == ("differs" if wrong else "holds")
    assert {"bounds", "answered"} <= set(claims)
    assert json.loads((folder / "summary.json").read_text())["violations"] == wrong


def test_every_selected_point_has_an_outcome(small):
    dataset, _ = small
    refused = dataset.sel(difficulty="extra_edges", quantity="transition_moduli", seed=0).outcome.values[-1]
    assert refused == Outcome.refused
    for name in ("near_singular", "small_strain", "extra_edges"):
        for quantity in map(str, dataset["quantity"].values):
            if quantity in peers.PEERS:
                continue
            selected = quantity in problems.DIFFICULTIES[name].quantities
            outcomes = dataset.outcome.sel(difficulty=name, quantity=quantity).values
            assert (outcomes != Outcome.absent).all() == selected


def test_peers_are_counted_apart(small):
    dataset, folder = small
    summary = json.loads((folder / "summary.json").read_text())
    fire = summary["peers"]["FIRE"]
    assert fire["points"] == fire["right"] + fire["wrong"] + fire["reported"] == 4
    # Far from the transition FIRE is right; where forces begin below its tolerance it is wrong by the whole step.
    assert fire["right"] >= 1 and fire["wrong"] >= 2 and fire["largest_error"] > 0.5
    outcome = dataset.outcome.sel(quantity="FIRE")
    assert (outcome.sel(difficulty="extra_edges") == Outcome.absent).all()
    assert "FIRE" not in summary["outcomes"] and summary["violations"] == 0
    assert "SILENT" in report.map_figure(dataset, "peers").subfigs[0].get_suptitle()


@pytest.mark.parametrize(
    "status, error, outcome",
    [
        (Status.ok, 1e-3, Outcome.tolerated),
        (Status.ok, 0.5, Outcome.violation),
        (Status.ok, np.nan, Outcome.violation),
        (Status.stalled, 0.5, Outcome.reported),
    ],
)
def test_a_peer_is_right_reported_or_silently_wrong(status, error, outcome):
    assert peers.judged(status, error).outcome is outcome


def test_a_fabricated_violation_is_counted(small):
    dataset, _ = small
    # Nothing else is wrong in this copy.
    clean = dataset.copy(deep=True)
    clean.outcome.values[clean.outcome.values == Outcome.violation] = Outcome.reported
    claims = {claim.key: claim for claim in report.claims(clean)}
    assert (claims["violations"].verdict, claims["violations"].value[:2]) == ("holds", "0 ")
    place = {"difficulty": "small_strain", "quantity": "equilibrium_newton", "seed": 0, "step": 1}
    clean.outcome.loc[place], clean.violation.loc[place] = Outcome.violation, Violation.above_bound
    claims = {claim.key: claim for claim in report.claims(clean)}
    assert claims["violations"].verdict == "differs"
    assert "1 small_strain/equilibrium_newton (above bound)" in claims["violations"].value
    assert "1 SILENT WRONG ANSWERS" in report.map_figure(clean, "tasks").subfigs[0].get_suptitle()
