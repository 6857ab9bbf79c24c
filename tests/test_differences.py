"""The check of derivatives passes right ones and fails wrong ones."""

import numpy as np
import pytest
from derivatives import assert_derivative, second_derivative

X, DIRECTIONS = np.array([0.3, -0.8, 1.1]), np.eye(3)


def value(x):
    return np.sum(np.exp(x)) + x[0] * x[1] ** 2


GRADIENT = np.exp(X) + np.array([X[1] ** 2, 2 * X[0] * X[1], 0.0])


@pytest.mark.parametrize(
    "wrong",
    [-GRADIENT, GRADIENT[::-1], GRADIENT * (1 + 1e-6), GRADIENT + np.array([0, 0, 1e-6])],
    ids=["sign", "order", "factor", "one entry"],
)
def test_wrong_derivatives_fail(wrong):
    with pytest.raises(AssertionError, match="Not equal"):
        assert_derivative(value, wrong, X, DIRECTIONS)


def test_second_derivatives():
    assert second_derivative(np.exp) == pytest.approx(1.0, rel=1e-9)
