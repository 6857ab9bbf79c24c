"""The boundary study end to end, small: b against the images that edges join, and sheared boundaries."""

import json

import numpy as np

STUDY = "boundary"


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
