"""How extras join the scene: their declarations, and what is said of one that is not installed."""

import tomllib
from dataclasses import replace

import pytest
from known_extras import LIST, declared

from critflow import InputError, extensions, lattice, quantity


@pytest.fixture
def without(monkeypatch):
    """A function that takes an extra away, as if its folder were deleted."""

    def remove(extra):
        rest = {name: one for name, one in extensions.extras().items() if name != extra}
        monkeypatch.setattr(extensions, "extras", lambda: rest)
        extensions.quantities.cache_clear()

    yield remove
    extensions.quantities.cache_clear()


def test_the_list_of_names_is_that_of_the_declarations():
    """An extra of one's own needs no line; of an extra that is deleted the line stays."""
    listed = tomllib.loads(LIST.read_text(encoding="utf-8"))
    assert {name: names for name, names in declared().items() if name in listed} == {
        name: names for name, names in listed.items() if name in extensions.extras()
    }, "run python tests/known_extras.py"
    names = [name for names in listed.values() for name in names]
    assert len(names) == len(set(names))


def test_a_name_of_an_extra_that_is_not_installed(without):
    listed = tomllib.loads(LIST.read_text(encoding="utf-8"))
    extra, names = next((extra, names) for extra, names in listed.items() if names)
    without(extra)
    assert {extensions.missing(name) for name in names} == {extra}
    assert extensions.missing(f"{names[0]}[dilation]") == extra
    assert extensions.missing("nonsense") is None
    with pytest.raises(InputError, match=f"words belong to the extra '{extra}' of critflow, which is not installed"):
        extensions.provided(names[0], "words")


def test_a_service_that_nobody_declares():
    with pytest.raises(InputError, match="words belong to an extra of critflow that is not installed"):
        extensions.provided("nonsense", "words")


def test_a_quantity_of_an_extra_that_is_not_installed(without):
    without("cables")
    network = lattice("honeycomb", 2, 2)
    with pytest.raises(InputError, match=r"onset\[uniaxial\]' is of the extra 'cables' of critflow, which is not"):
        quantity(network, "onset[uniaxial]")
    with pytest.raises(InputError, match=r"and modulus\[D\].* of a deformation D: ") as error:
        quantity(network, "nonsense")
    assert "onset" not in str(error.value)


def test_components_of_an_extra_that_is_not_installed(without):
    """The list of an extra has them by their axes, S_AXES and C_AXES."""
    without("design_names")
    network = lattice("honeycomb", 2, 2)
    for name in ("S_xy", "C_xxyy"):
        with pytest.raises(InputError, match=f"'{name}' is of the extra 'design_names' of critflow, which is not"):
            quantity(network, name)
    with pytest.raises(InputError, match="choose from B_0, G_0") as error:
        quantity(network, "nonsense")
    assert "S_xx" not in str(error.value)


def test_a_service_of_an_extra_that_needs_one_that_is_not_installed():
    extra = next(one for one in extensions.extras().values() if one.functions)
    with pytest.raises(InputError, match=f"'{extra.name}' of critflow needs the extra 'nonsense', which is not"):
        replace(extra, needs=["nonsense"]).named(next(iter(extra.functions.values())))


def share(network, pair):
    """A factory of quantities."""
    raise ValueError(pair)


def test_what_an_extra_writes_in_brackets_goes_to_its_factory(monkeypatch):
    """Names in other words than EDGE, FACE and D, such as a pair of vertices."""
    monkeypatch.setattr("critflow.quantities.quantities", lambda: {"share[I-J]": f"{__name__}:share"})
    network = lattice("honeycomb", 2, 2)
    with pytest.raises(ValueError, match="3-5:1:0"):
        quantity(network, "share[3-5:1:0]")
    with pytest.raises(InputError, match=r"did you mean 'share\[I-J\]'.*V_tau, share\[I-J\], and modulus\[D\] of a"):
        quantity(network, "shar[3-5]")
