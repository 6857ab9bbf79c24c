"""Sentences that users get for mistakes: for each call and each command, the kind of error and its decisive words."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr
from mistake_checks import (  # noqa: F401 (fixtures)
    BEST,
    CRITICAL,
    MAKES_ONE,
    NETWORK,
    STATE,
    give_their_codes_and_sentences,
    give_their_sentences,
    here,
)

import critflow as cf
import critflow_extras as ce
from critflow import InputError, SolveError


def dataset():
    """Two critical configurations on each of two networks, as they are read from a file."""
    networks = [cf.voronoi_network(n_vertices=40, seed=seed) for seed in (0, 1)]
    critical = [[cf.CriticalManifold(n).configuration(sigma * np.ones(60)) for sigma in (1.0, 2.0)] for n in networks]
    arrays = {
        "edges": (("seed", "edge", "end"), [n.edges for n in networks]),
        "offsets": (("seed", "edge", "axis"), [n.offsets for n in networks]),
        "cell": (("seed", "cell_vector", "axis"), [n.cell for n in networks]),
        "sigma": (("seed", "population", "edge"), [[c.sigma for c in row] for row in critical]),
        "position": (("seed", "population", "vertex", "axis"), [[c.coordinates for c in row] for row in critical]),
    }
    made = xr.Dataset(arrays, {"seed": [0, 1], "population": ["max_B_0", "random_stress"]})
    with TemporaryDirectory() as folder:
        made.to_netcdf(file := Path(folder) / "cases.nc", encoding={"population": {"dtype": "S1"}})
        return xr.load_dataset(file)


DATASET = dataset()

CALLS = {
    "certificate of a network": (
        lambda: ce.certify(NETWORK),
        *(InputError, "critical must be a CriticalConfiguration, not a Network", MAKES_ONE),
    ),
    "quantity in lower case": (lambda: cf.quantity(NETWORK, "C_b"), InputError, "did you mean 'C_B'?"),
    "property misspelt": (lambda: ce.properties(BEST, ["B0"]), InputError, "did you mean 'B_0'?"),
    "quantity of no edge": (
        lambda: cf.quantity(NETWORK, "length[500]"),
        *(InputError, "length[500]", "90 edges", "counted from 0"),
    ),
    "drawing of a dataset": (
        lambda: ce.draw(DATASET),
        *(InputError, "a Dataset cannot be drawn", "give a network, a configuration or a state"),
    ),
    "colour a word": (
        lambda: ce.draw(BEST, color="red"),
        *(InputError, "color must be an array of numbers", "not 'red'"),
    ),
    "a picture in place of axes": (
        lambda: ce.draw(BEST, "x.png"),
        *(InputError, "ax must be an Axes, not 'x.png'", "draw(...).figure.savefig('x.png')"),
    ),
    "elasticity of a network": (
        lambda: cf.elasticity(NETWORK),
        *(InputError, "elasticity of a network depends on its configuration", "give coordinates"),
    ),
    "deformation misspelt": (
        lambda: ce.critical_strain(NETWORK, 1.05 * CRITICAL.lengths, "shear"),
        *(InputError, "no deformation is called 'shear'", "simple_shear, pure_shear"),
    ),
    "lengths too short": (
        lambda: ce.critical_strain(NETWORK, np.ones(7), "simple_shear"),
        *(InputError, "rest_lengths must have one value per edge", "shape (90,), not (7,)"),
    ),
    "beyond the bound": (
        lambda: ce.design(NETWORK, {"B_0": 1.0}),
        *(SolveError, "B_0 is at most 0.28664132", "its bound for every stress", "1 was requested"),
    ),
    "no such quantity": (
        lambda: ce.design(NETWORK, {"mu": -0.5}),
        *(InputError, "no quantity is called 'mu'", "choose from B_0, G_0", "modulus[D]"),
    ),
    "targets as a set": (
        lambda: ce.design(NETWORK, {"B_0"}),
        InputError,
        "targets must be a Mapping",
        "{'B_0': 0.25}",
        "not a set",
    ),
    "Poisson's ratio by its symbol": (lambda: ce.design(NETWORK, {"nu": -0.5}), InputError, "'poisson'"),
    "Young's modulus by its symbol": (lambda: ce.design(NETWORK, {"E": 1.0}), InputError, "isotropic_targets"),
    "a target of another change": (
        lambda: ce.design(NETWORK, {"poisson": -0.5}),
        *(InputError, "poisson is a target of change='stiffness', not of change='stress'"),
    ),
    "no such quantity of stiffnesses": (
        lambda: ce.design(STATE, {"mu": -0.5}, change="stiffness"),
        *(InputError, "no quantity is called 'mu'", "choose from B_0, G_0", "modulus[D]"),
    ),
    "a network in place of springs": (
        lambda: ce.design(NETWORK, {"poisson": -0.5}, change="stiffness"),
        *(InputError, "change='stiffness' starts from springs on edges", "spring_state(network, ...)"),
    ),
    "limits of an unknown quantity": (
        lambda: ce.design(STATE, {"B_0": 0.2}, change="stiffness", within={"colour": (0.1, 10)}),
        *(InputError, "edges have no quantity 'colour'", "choose from stiffnesses"),
    ),
    "objectives one by one": (
        lambda: ce.pareto(NETWORK, "B_0", "C_G0", 3),
        *(InputError, "both objectives stand in one list", "pareto(network, ['B_0', 'V_L'], 11)"),
    ),
    "one objective": (lambda: ce.pareto(NETWORK, "B_0"), InputError, "both objectives stand in one list"),
    "a target without its value": (
        lambda: ce.prune_towards(BEST, "B_0", 0.2),
        *(InputError, "targets must be a Mapping", "not 'B_0'"),
    ),
    "columns in place of a network": (
        lambda: ce.network_from({"x": [0, 1]}),
        *(InputError, "{'x': [0, 1]}", "not a known source of a network", "edges= and positions="),
    ),
    "a whole dataset": (
        lambda: ce.network_from(DATASET),
        *(InputError, "choose one seed and one population", "dataset.sel(seed=0, population='max_B_0')"),
    ),
    "several cases of a dataset": (
        lambda: ce.network_from(DATASET.sel(seed=1)),
        *(InputError, "choose one population", "dataset.sel(population='max_B_0')"),
    ),
    "unknown ending": (
        lambda: ce.write_network(BEST, "x.npz"),
        *(InputError, "the ending '.npz' of 'x.npz'", "choose one of .csv", ".graphml", ".vtu"),
    ),
}

COMMANDS = {
    "examine no file": (
        ["examine", "nowhere.csv"],
        *(2, "there is no file nowhere_edges.csv", "check its name", "NAME_edges.csv and NAME_vertices.csv"),
    ),
    "examine one of two tables": (
        ["examine", "text.txt"],
        *(2, "there is no file text_edges.txt", "one of two tables", "give the other one after it"),
    ),
    "examine without a boundary": (["examine", "star.csv"], 2, "--pins hull fixes"),
    "examine with an option of polygons": (
        ["examine", "star.csv", "--pins", "hull", "--weld", "0.1"],
        *(2, "--weld belongs to polygons", "leave it out"),
    ),
    "show an unknown axis": (
        ["show", "RESULTS/tiny.nc", "--set", "sed=1"],
        *(2, "the dataset has no axis 'sed'", "did you mean 'seed'?"),
    ),
    "show an unknown value": (
        ["show", "RESULTS/tiny.nc", "--set", "population=flopy"],
        *(2, "population has no 'flopy' here", "did you mean 'floppy'?"),
    ),
    "show an unknown number": (
        ["show", "RESULTS/tiny.nc", "--set", "seed=999"],
        *(2, "seed has no '999' here", "seeds are 0 to "),
    ),
    "show several": (
        ["show", "RESULTS/tiny.nc", "--set", "seed=1"],
        *(2, "which population?", "add --set population=random"),
    ),
    "show in no folder": (
        ["show", "RESULTS/tiny.nc", "--set", "seed=1", "--out", "nowhere/x.png"],
        *(2, "there is no folder nowhere for x.png", "make it, or choose another"),
    ),
    "show as a text": (
        ["show", "RESULTS/tiny.nc", "--set", "seed=1", "--out", "x.doc"],
        *(2, "a picture cannot have the ending '.doc'", "choose .png, .pdf or .svg"),
    ),
    "no such network": (
        ["run", "ensemble", "--set", "network=nowhere.csv"],
        *(2, "network=nowhere.csv", "there is no file nowhere_edges.csv", "check its name"),
    ),
    "convert no file": (["convert", "nowhere.csv", "x.json"], 2, "no file nowhere_edges.csv", "check its name"),
    "convert to no file": (["convert", "text.txt"], 2, "a file to read and one to write", "convert FILE OUT"),
    "convert to an unknown ending": (
        ["convert", "star.csv", "x.npz", "--pins", "hull"],
        *(2, "the ending '.npz' of 'x.npz'", "choose one of .csv"),
    ),
    "convert a picture": (
        ["convert", "fibres.png", "x.json"],
        *(2, "fibres.png is read by scikit-image and skan", "docs/recipes/pictures.md", "--labels for a mask"),
    ),
    "convert to a workbook": (
        ["convert", "star.csv", "x.xlsx", "--pins", "hull"],
        *(2, "x.xlsx is written by pandas", "docs/recipes/workbooks.md", "choose .csv"),
    ),
    "explore at too large a port": (["explore", "--port", "99999"], 2, "'--port'", "0<=x<=65535"),
    "explore no file": (["explore", "nowhere.csv"], 2, "no file nowhere_edges.csv", "check its name"),
    "make without --out": (["make", "star.csv"], 2, "Missing option '--out'"),
    "make a target without its value": (
        ["make", "star.csv", "--pins", "hull", "--out", "m.csv", "--target", "C_B"],
        *(2, "NAME=VALUE"),
    ),
}

test_a_wrong_call_gives_its_kind_of_error_and_its_sentence = give_their_sentences(CALLS)
test_a_wrong_command_gives_its_exit_code_and_its_sentence = give_their_codes_and_sentences(COMMANDS)


def test_a_plane_network_is_written_without_the_size_of_its_model(tmp_path):
    assert ce.write_network(BEST, tmp_path / "x.stl") is None
