"""The study of weak bending: its scaling function, extrapolated exponents and errors."""

import numpy as np

from critflow import Status
from studies.weak_forces import PLACES, limit_of_smallest, scaling_function


def test_tensions_of_the_cubic_equation_are_one_curve(runs):
    _, dataset = runs("weak_forces")
    scaled = (dataset.cubic / dataset.unit).values
    np.testing.assert_allclose(scaled, np.broadcast_to(scaling_function(PLACES), scaled.shape), rtol=1e-9)
    np.testing.assert_allclose(scaling_function([0.0, 1.5]) ** 3 - [0, 1.5 * scaling_function([1.5])[0] ** 2], 1)


def test_exponents_are_extrapolated_in_powers_of_the_cube_root():
    kappas = np.array([1e-7, 1e-6, 1e-5, 1e-4])
    exact = np.array([[2 / 3], [1.5]])
    apparent = exact - 0.3 * np.cbrt(kappas) + 5 * np.cbrt(kappas) ** 2
    np.testing.assert_allclose(limit_of_smallest(apparent, kappas), exact[:, 0], rtol=1e-12)
    np.testing.assert_allclose(limit_of_smallest(exact, kappas[:1]), exact[:, 0])


def test_every_tension_has_its_error_beside_it(runs):
    _, dataset = runs("weak_forces")
    for name in ("full", "cubic"):
        assert dataset[name].attrs["ancillary_variables"] == f"{name}_error_bound"
    known = dataset.tension_status == Status.ok
    assert bool(
        (dataset.full_error_bound.where(known) <= dataset.cubic_error_bound.where(known)).where(known, True).all()
    )
