"""The gallery study end to end, small: thirteen panels whose arrays bear out what the figure and the claims say."""

import numpy as np

from critflow import Status
from critflow.workflow.load import load_study

PANELS = load_study("gallery").study.axes[1].values

STUDY = "gallery"


def test_only_wide_rest_lengths_leave_edges_slack(dataset):
    status = dataset.status.transpose("panel", "seed")
    slack = [panel for panel in PANELS if (status.sel(panel=panel) != Status.ok).any()]
    assert slack == ["random_lengths_wide"]
    assert set(np.unique(status)) <= {Status.ok, Status.slack_edges}


def test_claims_change_their_verdict_with_the_arrays(dataset):
    claims = load_study("gallery").study.claims
    for name, panel, factor, key in (
        ("tension_variance", "tension_variance_inflated", 1 + 1e-9, "Networks-BC"),
        ("bulk_modulus_0", "bulk_modulus_wave", 1 - 1e-11, "Networks-DEF"),
        ("bulk_modulus_affine", "bulk_modulus", 1.01, "BulkModulusAffine"),
        ("flat_directions", "bulk_modulus", 2, "BulkModulusHessian"),
        ("shear_modulus_0", "shear_modulus_2", 0.1, "Networks-GHI"),
        ("stressed_fraction", "random_lengths", 0.99, "Networks-JK-spread"),
    ):
        changed = dataset.copy(deep=True)
        changed[name].loc[{"panel": panel}] *= factor
        assert {claim.key: claim.verdict for claim in claims(changed)}[key] == "differs", key
    assert claims(dataset.sel(panel=["random_stress_1"])) == []
