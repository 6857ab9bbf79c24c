"""Cost of studies: the selected variables are computed with the same bits, and nothing else is computed."""

from itertools import groupby

import pytest
from problems import Factorisations

from critflow import Status, voronoi_network
from critflow.engine.code_digest import load_study
from critflow.engine.dataset import Assembly, opened_dataset, write_dataset
from critflow.engine.settings import select
from critflow.engine.store import Folder
from critflow.engine.tasks import Job, compute_network


def stored(name, words, path):
    """The dataset of a run, without its report."""
    loaded = load_study(name)
    selection = select(loaded.study, words)
    folder, parameters = Folder(path), selection.parameters
    for part in (folder.shards, folder.failed):
        part.mkdir(parents=True, exist_ok=True)
    job = Job(str(loaded.path), loaded.digest, str(path), parameters, selection.study.selected, (name,), "this code")
    for _, cases in groupby(selection.cases, lambda case: case.values["seed"]):
        compute_network(job, [case.values for case in cases])
    write_dataset(Assembly(selection, folder.shards, folder.states(selection)), folder.dataset(name), {"history": name})
    with opened_dataset(folder.dataset(name)) as dataset:
        return dataset.load()


LINEAR = ("seeds=1:3", "n_vertices=60", "populations=max_B_0,random_stress")


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    """The dataset of all variables of the ensemble."""
    return stored("ensemble", LINEAR, tmp_path_factory.mktemp("ensemble"))


SELECTIONS = {
    "C_B alone": ("C_B,B_0", {"P", "saddle"}),
    "closed forms": ("B_0,G_0,stressed_fraction,V_L", {"P"}),
    "the configuration": ("sigma,position,edges,offsets,cell", {"P"}),
    "the path": ("C_B_fit,energy", {"P", "Hessian"}),
    "scalars": ("scalars", {"P", "saddle", "Hessian"}),
}


@pytest.mark.parametrize("selection", SELECTIONS)
def test_selected_variables_have_the_same_bits(everything, monkeypatch, tmp_path, selection):
    variables, matrices = SELECTIONS[selection]
    made = []

    def compute():
        made.append(stored("ensemble", [*LINEAR, f"variables={variables}"], tmp_path))

    assert set(Factorisations(monkeypatch)(voronoi_network(60, seed=1), compute)) == matrices
    few = made[0]
    selected = {*variables.split(","), "status", "valid"}
    if variables == "scalars":
        selected = {v for v in everything if set(everything[v].dims) == {"population", "seed"}}
    assert set(few.data_vars) == selected
    assert (few.status == Status.ok).all()
    for variable in few.data_vars:
        assert few[variable].values.tobytes() == everything[variable].values.tobytes(), variable
    assert ("strain" in few.dims) == ("energy" in few)
