"""The study of tension inference, small: its errors scale with the noise, and with pressures they are larger."""

import numpy as np
import pytest

from critflow import Status


def test_errors_of_the_inference_scale_with_the_noise(runs):
    _, dataset = runs("tension_inference")
    assert (dataset.inference_status == Status.ok).all()
    error = dataset.error.values
    assert error[:, 0, 1] / error[:, 0, 0] == pytest.approx(1000, rel=0.1)
    # Where pressures are ignored the error is theirs, at any noise.
    assert error[:, 2, 1] == pytest.approx(error[:, 2, 0], rel=0.1) and (error[:, 2] > 0.02).all()
    assert (dataset.amplification[:, 1] > dataset.amplification[:, 0]).all()
    # Stated errors are of the size of the true ones: mean squares of few networks.
    assert (np.abs(np.log(dataset.deviation[:, :2, 0])) < 2).all()


def test_vertices_on_sides_reduce_the_errors_of_tensions(runs):
    _, dataset = runs("tension_inference")
    assert (dataset.side_status == Status.ok).all()
    assert dataset.side_error[:, 0].median() > 3 * dataset.side_error[:, 1].median()
    assert ((dataset.side_ratio > 0.2) & (dataset.side_ratio < 2.5)).all()
    assert (np.abs(dataset.side_chi_squared[:, 1] - 1) < 0.5).all() and (dataset.side_freedom[:, 1] == 60).all()
