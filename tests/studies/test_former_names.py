"""Datasets of schema 3: converted by the function of the documents, and refused otherwise."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from critflow import network_from
from critflow.result import StudyError
from critflow.workflow.dataset import opened_dataset
from critflow.workflow.former_names import POPULATIONS, VARIABLES
from critflow.workflow.store import SCHEMA_VERSION, append_seal

STUDY = "ensemble"
PAGE = Path(__file__).parents[2] / "docs" / "howto" / "dataset.md"
ADDED = ["valid", "population_label", "population_symbol", "population_color"]


def documented(name):
    """A function of the page on the dataset."""
    block = next(code for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S) if f"def {name}(" in code)
    scope = {"xr": xr}
    exec(block, scope)
    return scope[name]


@pytest.fixture
def former(dataset, tmp_path):
    """The file of a dataset with the names of schema 3."""
    cell = dataset.cell.rename(axis="axis_").rename(cell_vector="axis")
    back = {new: old for old, new in VARIABLES.items() if new in dataset}
    old = dataset.drop_vars(["cell", *ADDED]).rename(back).assign(cell=cell)
    words = {new: word for word, new in POPULATIONS.items()}
    old["population"] = [words.get(str(p), str(p)) for p in dataset.population.values]
    old.attrs["schema_version"] = 3
    old.drop_encoding().to_netcdf(tmp_path / "old.nc")
    append_seal(tmp_path / "old.nc")
    return tmp_path / "old.nc"


def test_a_file_of_schema_3_is_converted(dataset, former):
    with xr.open_dataset(former) as old:
        assert {"coordinates", "C_B_exact", "bulk_modulus_0", "bulk_modulus_error_bound"} <= old.variables.keys()
        assert "max_B_0" not in old.population and old.cell.dims == ("seed", "axis", "axis_")
    new = former.with_name("new.nc")
    documented("convert")(former, new)
    with opened_dataset(new) as converted:
        # Rest lengths of schema 3 were those of another spread, at the transition.
        present = ["random_lengths_narrow" if p == "random_lengths" else str(p) for p in dataset.population.values]
        expected = dataset.drop_vars(ADDED).assign_coords(population=present)
        assert list(map(str, converted.population.values)) == present
        assert (converted.valid == 1).all() and converted.valid.dtype.kind == "i"
        for name in expected.data_vars:
            assert converted[name].dims == expected[name].dims
            np.testing.assert_array_equal(converted[name].values, expected[name].values)
        case = converted.sel(seed=1, population="max_B_0").load()
    assert network_from(case).configuration.residual < 1e-12
    assert SCHEMA_VERSION == 4


def test_a_file_of_schema_3_is_refused(former):
    with pytest.raises(StudyError, match=r"schema 3.*docs/howto/dataset.md"), opened_dataset(former):
        pass


def test_the_selection_of_the_documents_keeps_integers_and_sound_cases(dataset):
    masked = dataset[["B_0", "C_B"]].where(dataset.valid)
    assert np.isfinite(masked.B_0).all() and set(masked.dims) == {"population", "seed"}
    wrong = dataset.copy()
    wrong["valid"] = dataset.valid.where(dataset.seed != 1, 0)
    assert np.isnan(dataset[["B_0"]].where(wrong.valid).B_0.sel(seed=1)).all()
