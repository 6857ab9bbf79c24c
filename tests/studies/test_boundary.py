"""The boundary study end to end, small: b against the images that edges join, and sheared boundaries."""

import json

import numpy as np
import pytest

from critflow import Status
from critflow.command.main import main
from critflow.workflow.load import load_study

STUDY = "boundary"


def test_three_edges_meet_at_every_vertex_with_forces_in_balance(dataset):
    assert (dataset.status == Status.ok).all()
    for seed in dataset.seed.values:
        one = dataset.sel(seed=seed)
        edges, b = one.edges.values, one.offsets.values @ one.cell.values
        np.testing.assert_allclose(b, one.boundary_vectors, rtol=0, atol=1e-14)
        force, met = np.zeros((40, 2)), np.zeros(40)
        for (tail, head), sigma, shift in zip(edges, one.sigma.values, b, strict=True):
            pull = sigma * (one.coordinates.values[head] + shift - one.coordinates.values[tail])
            force[tail] += pull
            force[head] -= pull
            met[[tail, head]] += 1
        assert (met == 3).all()
        np.testing.assert_allclose(force, 0.0, rtol=0, atol=1e-12)


def test_sheared_bond_vectors_are_sheared(dataset):
    for shear in dataset.shear.values:
        one = dataset.sel(shear=shear)
        x, y = np.moveaxis(one.bond_vectors.values, -1, 0)
        np.testing.assert_allclose(one.sheared_bond_vectors, np.stack([x + shear * y, y], axis=-1), rtol=0, atol=1e-12)


def test_nearest_images_fail_more_the_larger_the_shear(dataset):
    wrong = dataset.nearest_image_wrong.sum("seed").values
    # Without shear an edge is the shortest way between its ends unless it is longer than half the cell.
    length = np.linalg.norm(dataset.bond_vectors.values, axis=-1)
    assert wrong[0] <= np.count_nonzero(length > np.sqrt(40) / 2)
    assert wrong[-1] > wrong[0]


def test_claims_and_figure(folder, assert_picture):
    claims = json.loads((folder / "claims.json").read_text())
    assert {claim["key"] for claim in claims if claim["verdict"] == "differs"} == {"BoundaryTerm-side"}
    assert len(claims) == 8
    assert_picture(folder / "figures" / "boundary.png", 20_000)


def test_too_few_vertices_are_refused(tmp_path, capsys):
    assert main(["run", "boundary", "--workers", "0", "--out", str(tmp_path), "--set", "n_vertices=7"]) == 2
    assert capsys.readouterr().err


@pytest.mark.parametrize(
    "variable, said",
    [
        ("boundary_vectors", "boundary_vectors, bond_vectors"),
        ("sigma", "sigma, force balance"),
        ("sheared_cell", "sheared_cell at 0"),
        ("sheared_bond_vectors", "sheared_bond_vectors at 0"),
    ],
)
def test_verify_names_what_does_not_follow(folder, dataset, variable, said, capsys):
    assert main(["verify", str(folder)]) == 0
    assert "physics was recomputed" in capsys.readouterr().out
    changed = dataset.copy(deep=True)
    changed[variable].values[...] += 1 + np.random.default_rng(1).random(changed[variable].shape)
    problems = load_study("boundary").study.verify(changed)
    assert problems
    assert all(said in problem for problem in problems), problems
