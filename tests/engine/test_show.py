"""The choice of a case of a dataset by the command, and its figure."""

import numpy as np
import pytest
import xarray as xr

import critflow as cf
from critflow import InputError, Status, extensions
from critflow.command.cases import draw_case


@pytest.mark.parametrize(
    ("setting", "word"),
    [("sed=1", "'seed'"), ("population=flopy", "'floppy'"), ("seed=1", "add --set population=random")],
)
def test_a_mistake_in_the_choice_gives_one_sentence_and_draws_nothing(results, said, setting, word):
    before = sorted(results.rglob("*"))
    out, err = said(["show", str(results / "tiny.nc"), "--set", setting], 2)
    assert (out, len(err.splitlines())) == ("", 1)
    assert err.startswith("critflow: ") and word in err
    assert sorted(results.rglob("*")) == before


def test_a_table_is_no_damaged_dataset(tmp_path, said):
    cf.write_network(cf.lattice("honeycomb", 2, 2), tmp_path / "n.csv")
    assert "n_edges.csv is no dataset: give a file NAME.nc" in said(["show", str(tmp_path / "n_edges.csv")], 2).err


def dataset(network, status=Status.ok):
    """A dataset of one case, without the engine."""
    critical = cf.CriticalManifold(network).configuration(network.stiffness)
    arrays = {
        "edges": (("edge", "end"), network.edges),
        "offsets": (("edge", "axis"), network.offsets),
        "cell": (("cell_vector", "axis"), network.cell),
        "position": (("vertex", "axis"), critical.coordinates),
        "sigma": (("edge",), critical.sigma),
        "status": ((), int(status)),
        "B_0": ((), 0.25),
    }
    variables = {name: (("seed", *dims), np.asarray(values)[None]) for name, (dims, values) in arrays.items()}
    return xr.Dataset(variables, coords={"seed": [3]}, attrs={"axes": "seed"})


def test_a_case_is_drawn_with_its_status_and_its_moduli(tmp_path, empty_pictures):
    with empty_pictures():
        text = draw_case(dataset(cf.voronoi_network(16, seed=1)), ["seed=3"], None, tmp_path)
    assert text.splitlines() == [
        "seed 3: ok, converged to the requested tolerance",
        "B_0 = 0.25 k",
        f"drawn in {tmp_path / 'seed-3.png'}",
    ]
    assert (tmp_path / "seed-3.png").read_bytes().startswith(b"\x89PNG")


def test_a_case_in_space_is_drawn_by_critflow_extras(tmp_path, monkeypatch):
    monkeypatch.setattr(extensions, "has_extras", lambda: False)
    with pytest.raises(InputError, match="drawings in space need critflow-extras"):
        draw_case(dataset(cf.lattice("diamond", 2, 2, 2)), [], None, tmp_path)


def test_a_case_without_a_configuration_is_one_sentence(tmp_path):
    plane = dataset(cf.voronoi_network(16, seed=1))
    for cases, word in (
        (plane.assign(status=("seed", [int(Status.failed)])), "seed-3 has no configuration: the case raised"),
        (plane.assign(sigma=plane.sigma * np.nan), "no stresses"),
        (plane.drop_vars("sigma"), "no stresses"),
        (plane.drop_vars("position"), "lacks position"),
    ):
        with pytest.raises(InputError, match=word):
            draw_case(cases, [], None, tmp_path)
    assert not list(tmp_path.iterdir())
