"""Spring laws: closed forms to the last digits, derivatives, and user-defined laws."""

from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from refusals import refused

from critflow import (
    Cable,
    CriticalManifold,
    Hookean,
    InputError,
    Network,
    PowerLaw,
    SpringLaw,
    Status,
    WormLike,
    elasticity,
    equilibrium,
    spring_state,
    stiffening,
    strain_path,
    voronoi_network,
)
from critflow.springs import checked_law

LAWS = [Hookean(), *map(PowerLaw, (2, 2.5, 3, 4, 7.5)), *map(WormLike, (2.0, 0.3, 0.01))]
REST, K = np.array([0.7, 1.0, 1.9]), np.array([0.5, 1.0, 3.0])


def by_definition(law, e: Decimal, rest: Decimal, k: Decimal) -> tuple[Decimal, Decimal]:
    """Energy and tension with forty digits, from formulas with cancellation near rest."""
    if isinstance(law, WormLike):
        m = Decimal(law.slack)
        u, scale = e / (m * rest), 2 * k * m * rest / 3
        return scale * m * rest * ((1 / (1 - u) - 1 - u) / 4 + u**2 / 2), scale * (
            1 / (4 * (1 - u) ** 2) - 1 / Decimal(4) + u
        )
    n = Decimal(getattr(law, "exponent", 2))
    stretch = 1 + e / rest
    return k * rest**2 / (n - 1) * ((stretch**n - 1) / n - stretch + 1), k * rest / (n - 1) * (stretch ** (n - 1) - 1)


@pytest.mark.parametrize("part", [-0.9, -0.3, -1e-3, -1e-9, 1e-12, 1e-6, 1e-2, 0.3, 0.8, 3.0])
@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_full_accuracy_near_rest(law, part):
    # Extensions as a fraction of the range of the law; a power law may shorten to zero length.
    reach = law.slack if isinstance(law, WormLike) and part > 0 else 1.0
    if isinstance(law, WormLike) and part > 1:
        return
    e = part * reach * REST
    energies, tensions = law.energy(e, REST, K), law.tension(e, REST, K)
    with localcontext() as context:
        context.prec = 60
        for i in range(3):
            energy, tension = by_definition(law, *(Decimal(float(v[i])) for v in (e, REST, K)))
            # The rounding of λ or 1 − u at part 0.8 counts thrice in (1 − u)⁻³, sevenfold in λ^7.5.
            assert energies[i] == pytest.approx(float(energy), rel=2e-14, abs=0)
            assert tensions[i] == pytest.approx(float(tension), rel=1e-14, abs=0)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_functions_are_successive_derivatives(law):
    chain = (law.energy, law.tension, law.stiffness, law.stiffening)
    reach = law.slack if isinstance(law, WormLike) else 1.0
    for part in (-0.4, 0.0, 0.4):
        e, h = part * reach * REST, 1e-3 * reach * REST
        for function, derivative in pairwise(chain):
            f = {n: function(e + n * h, REST, K) for n in (-2, -1, 1, 2)}
            difference = (8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * h)
            scale = np.abs(derivative(0.5 * reach * REST, REST, K))
            assert (np.abs(derivative(e, REST, K) - difference) <= 1e-9 * scale + 1e-15).all()


def test_worm_like_chains_diverge_at_the_contour_length():
    law = WormLike(0.2)
    # (1 − u)² E' → ⅙ k m ℓ, the strength of the divergence.
    e = 0.2 * (1 - 1e-6) * REST
    np.testing.assert_allclose(law.tension(e, REST, K) * 1e-12, K * 0.2 * REST / 6, rtol=1e-5)
    for e in (0.2 * REST, 0.21 * REST, 0.4 * REST, 5 * REST):
        assert (law.energy(e * (1 + 1e-12), REST, K) == np.inf).all()
        assert (law.tension(e * (1 + 1e-12), REST, K) == np.inf).all()


# User-defined laws


@dataclass(frozen=True)
class Quartic(SpringLaw):
    """E = ½ k e² + ¼ q k e⁴/ℓ², with faults to choose from."""

    q: float = 2.0
    offset: float = 0.0
    pull: float = 0.0
    softness: float = 1.0
    slope: float = 1.0

    def energy(self, e, rest, k):
        return self.offset + self.pull * k * e + self.softness * 0.5 * k * e**2 + 0.25 * self.q * k * e**4 / rest**2

    def tension(self, e, rest, k):
        return self.pull * k + self.softness * k * e + self.q * k * e**3 / rest**2

    def stiffness(self, e, rest, k):
        return self.softness * k + 3 * self.slope * self.q * k * e**2 / rest**2

    def stiffening(self, e, rest, k):
        return 6 * self.q * k * e / rest**2


@dataclass(frozen=True)
class Unsteady(Quartic):
    def tension(self, e, rest, k):
        return k * e + 0.1 * k * e * np.abs(e) / rest


@dataclass(frozen=True)
class Blind(Quartic):
    def stiffness(self, e, rest, k):
        return np.full_like(k, np.nan)


@dataclass(frozen=True)
class Tight(WormLike):
    """A law of the user's own that reaches hardly anywhere."""


class Ended(Quartic):
    """The tension is no number beyond an extension of 3 %, which no check at small extensions sees."""

    def tension(self, e, rest, k):
        return np.where(e > 0.03 * rest, np.nan, super().tension(e, rest, k))


class Bottomed(Quartic):
    """The tension is no number where a spring is pressed by more than half its length."""

    def tension(self, e, rest, k):
        return np.where(e < -0.5 * rest, np.nan, super().tension(e, rest, k))


@pytest.mark.parametrize("method", ["newton", "fire"])
def test_no_equilibrium_where_a_tension_is_no_number(method):
    critical = CriticalManifold(voronoi_network(20, seed=1)).configuration(np.linspace(0.2, 1, 30))
    rest = spring_state(critical.network, critical.lengths, critical.coordinates, Ended())
    state = rest.deformed(1.035 * np.eye(2))
    assert np.isnan(state.max_force) and np.isfinite(state.energy)
    found = equilibrium(state, method, throw=False)
    assert found.status is Status.stalled and "longer than its law allows" in found.note
    with pytest.raises(InputError, match="not in equilibrium"):
        elasticity(found.value)
    # A step that would pass the end of the law is shortened.
    assert equilibrium(rest.deformed(1.005 * np.eye(2)), method, throw=False).ok


def test_no_step_ends_where_a_tension_is_no_number():
    # The long spring pulls the short one past the end of its law, where its energy alone is a number.
    network = Network([[0, 1], [1, 2]], pins={0: [0.0, 0.0], 2: [21.5, 0.0]})
    state = spring_state(network, [1.0, 20.0], [[0.0, 0.0], [1.0, 0.0], [21.5, 0.0]], Ended(q=0.0))
    found = equilibrium(state, throw=False)
    assert found.status is Status.stalled and np.isfinite(found.value.max_force)


def test_valid_laws_pass():
    # Rounding at rest is accepted: the least k ℓ² is 0.245, the least ℓ is 0.7.
    rounded = Quartic(offset=2e-13), Quartic(pull=5e-13)
    # One value for each edge: several materials.
    of_edges = Quartic(np.array([0.0, 2.0, 50.0]))
    for law in (Quartic(), Quartic(-0.5), of_edges, *rounded, Bottomed(), Tight(0.5), Tight(1e-3), *LAWS):
        assert checked_law(law, REST, K) is law


class ConvexQuartic(Quartic):
    convex = True


def test_library_laws_are_convex_and_new_laws_are_not_assumed_to_be():
    assert all(law.convex for law in LAWS)
    assert not Quartic().convex
    assert checked_law(ConvexQuartic(2.0), REST, K).convex


@dataclass(frozen=True)
class EndedConvex(Quartic):
    """The energy is infinite beyond an extension of 0.9 ℓ, where the formula of the stiffness means nothing."""

    convex = True

    def energy(self, e, rest, k):
        return np.where(e > 0.9 * rest, np.inf, super().energy(e, rest, k))

    def stiffness(self, e, rest, k):
        return np.where(e > 0.9 * rest, -k, super().stiffness(e, rest, k))


@pytest.mark.parametrize("unit", [2.0**-21, 1.0, 2.0**21])
def test_convexity_is_asked_for_within_the_reach_of_a_law(unit):
    assert checked_law(EndedConvex(), unit * REST, K).convex


BAD = {
    "class": (Hookean, "law must be a SpringLaw"),
    "text": ("hookean", "law must be a SpringLaw"),
    "energy at rest": (Quartic(offset=0.1), "no energy and no tension at rest"),
    "tension at rest": (Quartic(pull=0.1), "no energy and no tension at rest"),
    "negative stiffness": (Quartic(softness=-1.0), r"has -1 k as its stiffness at rest.*minimum at rest"),
    "stiffness not k": (Quartic(softness=2.0), r"has 2 k as its stiffness at rest.*scale it"),
    "stiffness NaN": (Blind(), "has nan k as its stiffness"),
    "stiffness wrong": (Quartic(slope=2.0), "its stiffness is not the derivative of its tension"),
    "tension wrong": (Unsteady(), "its tension is not the derivative of its energy"),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_laws_raise_one_sentence(name):
    law, pattern = BAD[name]
    network = voronoi_network(12, seed=1)
    critical = CriticalManifold(network).configuration(np.ones(18))
    for call in (
        lambda: spring_state(network, critical.lengths, critical.coordinates, law),
        lambda: strain_path(critical, [0.01], law=law),
        lambda: stiffening(critical, law=law),
    ):
        with pytest.raises(InputError, match=pattern) as caught:
            call()
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 200


test_laws_and_numbers_that_are_none_are_refused = refused(
    {
        "more than rounding of the energy": (lambda: checked_law(Quartic(offset=5e-13), REST, K), "at rest"),
        "more than rounding of the tension": (lambda: checked_law(Quartic(pull=9e-13), REST, K), "at rest"),
        "a false claim of convexity": (lambda: checked_law(ConvexQuartic(-0.5), REST, K), "convex"),
        **{f"exponent {n}": (partial(PowerLaw, n), "at least 2") for n in (1.9, np.nan, np.inf)},
        **{f"slack {m}": (partial(WormLike, m), "positive") for m in (0.0, -1.0, np.nan, np.inf)},
    },
    InputError,
)


def test_a_cable_is_a_hookean_spring_that_resists_extension_only():
    e, rest, k = np.array([-0.3, -1e-12, 0.0, 1e-12, 0.4]), np.ones(5), np.linspace(1, 2, 5)
    pulled = e > 0
    for name in ("energy", "tension"):
        cable, spring = (getattr(law, name)(e, rest, k) for law in (Cable(), Hookean()))
        assert np.array_equal(cable, np.where(pulled, spring, 0.0))
    # At rest, where cables of a critical configuration are, it has its stiffness.
    assert np.array_equal(Cable().stiffness(e, rest, k), np.where(e >= 0, k, 0.0))
    assert not Cable().stiffening(e, rest, k).any()
