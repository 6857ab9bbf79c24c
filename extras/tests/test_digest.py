"""What of critflow-extras counts for the cases of a study: what it imports, declares or sets, with their imports.

The study of these tests belongs to a user: it stands in a file of its own.
"""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import critflow_extras
from critflow.command.main import main
from critflow.engine.code_digest import code_version, load_file, load_study, module_of, used_extras
from critflow.engine.settings import select

STUDY = """
from critflow import lattice, optimize, quantity
from critflow.engine import Axis, Study, Variable
from critflow.result import Status

def case(parameters, *, seed):
    network = lattice("honeycomb", 2, 2)
    return {"status": Status.ok, "value": value(network, parameters["quantity"])}

def value(network, name):
    return optimize(network, "B_0").objective

study = Study(
    name="own", title="A quantity of a lattice", axes=[Axis("seed", range(2), "seed")], parameters={"quantity": "B_0"},
    case=case,
    variables=[
        Variable("value", ("seed",), "f8", long_name="value"),
        Variable("status", ("seed",), "i1", long_name="outcome", flags=Status),
    ],
)
"""
OF_SETTING = ('optimize(network, "B_0").objective', "float(quantity(network, name).maximise)")
VALUE = 'return optimize(network, "B_0").objective'


@pytest.fixture
def own(tmp_path):
    """`own((old, new), ...)`: the file of the study with these changes."""

    def of(*changes):
        text = STUDY
        for old, new in changes:
            assert text.count(old) == 1
            text = text.replace(old, new)
        path = tmp_path / "own.py"
        path.write_text(text)
        return path

    return of


def folders(study):
    """The folders of critflow-extras that count for a study."""
    return {module.split(".")[1] for module in used_extras(study)}


IMPORTS = {  # what the study does with critflow-extras, and a folder whose code must count
    "a name": ((VALUE, "from critflow_extras import design\n    return design"), "targets"),
    "a name at the top": (("import Status\n", "import Status\nfrom critflow_extras import design\nD = design\n"), None),
    "the package": ((VALUE, "import critflow_extras as ce\n    return ce.design"), "targets"),
    "the package by its name": ((VALUE, "import critflow_extras\n    return critflow_extras.weak_forces"), "weak"),
    "a module": ((VALUE, "from critflow_extras.local.diagonals import face_diagonals as d\n    return d"), "local"),
    "a folder": ((VALUE, "import critflow_extras.weak.soft_spectrum as s\n    return s"), "weak"),
    "a declared function": (("parameters={", 'extras=["response_at_rest"], parameters={'), "rest"),
    "a declared quantity": (("parameters={", 'extras=["onset[dilation]"], parameters={'), "cables"),
    "a setting": (('"quantity": "B_0"', '"quantity": "onset[dilation]"'), "cables"),
    "a list of settings": (('"quantity": "B_0"', '"quantity": ["B_0", "local[0-1,2-3]"]'), "local"),
    "a component": (('"quantity": "B_0"', '"quantity": "C_xxyy"'), "design_names"),
    "words of an axis": (('Axis("seed", range(2), "seed")', 'Axis("seed", ["C_B", "G_0"], "seed")'), "design_growth"),
}


@pytest.mark.parametrize("use", IMPORTS)
def test_what_a_study_imports_declares_or_sets_counts(own, use):
    change, folder = IMPORTS[use]
    codes, counted = [], []
    for changes in ((), (change,)):
        study = select(load_file(own(*changes)).study).study
        codes.append(code_version(study).split(",")[0])
        counted.append(folders(study))
    assert not counted[0] and (folder in counted[1]) is (folder is not None)
    assert (codes[0] != codes[1]) is (folder is not None)


def test_what_an_import_imports_counts_and_nothing_else(own):
    change, _ = IMPORTS["a name"]
    counted = folders(load_file(own(change)).study)
    # What `design` changes stands in a table.
    assert {"targets", "design_pressures", "design_stiffness"} <= counted
    assert not counted & {"explore", "examine", "weak", "large"}


VERSION = """
import sys
from pathlib import Path
from critflow.engine.code_digest import code_version, load_file
print(code_version(load_file(Path(sys.argv[1])).study))
"""


def test_a_change_of_what_a_study_uses_counts_and_of_what_it_does_not_use_does_not(own, tmp_path, monkeypatch):
    """In a copy of critflow-extras, and processes of their own."""
    package = Path(critflow_extras.__file__).parent
    copy = tmp_path / "copy" / package.name
    shutil.copytree(package, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setenv("PYTHONPATH", str(copy.parent))
    command = [sys.executable, "-c", VERSION, own(IMPORTS["a name"][0])]

    def version(changed=()):
        for name in changed:
            with open(copy / name, "a") as file:
                file.write("\nADDED = 1\n")
        return subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout

    first = version()
    assert version(["weak/weak_forces.py", "examine/report.py", "__init__.py"]) == first
    assert version(["design_stiffness/stiffnesses.py"]) != first


@pytest.mark.parametrize("name", ["ensemble", "three_bar", "gallery", "shear", "boundary"])
def test_a_study_of_the_scene_counts_nothing_of_critflow_extras(name):
    assert not used_extras(select(load_study(name).study).study)


def test_public_names_have_the_modules_that_they_are_imported_from():
    for name in critflow_extras.__all__:
        assert getattr(critflow_extras, name).__module__ == module_of(name), name


UNDECLARED = ('optimize(network, "B_0").objective', 'float(quantity(network, "onset[dilation]").maximise)')


def run(path, out, *words):
    return main(["run", str(path), "--workers", "0", "--out", str(out), *words])


def failures(out):
    return [path.read_text().splitlines()[-1] for path in sorted((out / "failed").glob("*.txt"))]


def test_a_case_that_uses_what_does_not_count_fails_with_what_to_declare(own, tmp_path):
    """Every case, also those of a process that has imported it for another."""
    assert run(own(UNDECLARED), tmp_path / "out") == 3
    sentences = failures(tmp_path / "out")
    assert len(sentences) == 2 and all("extras=('onset[D]',) in the Study" in one for one in sentences)
    declared = own(UNDECLARED, ("parameters={", "extras=('onset[D]',), parameters={"))
    assert run(declared, tmp_path / "out", "--retry-failed") == 0


def test_a_quantity_of_a_setting_counts_for_every_network_of_a_process(own, tmp_path):
    path, out = own(OF_SETTING), tmp_path / "out"
    assert run(path, out, "--set", "quantity=onset[dilation]") == 0
    plain = select(load_file(path).study).study
    chosen = select(load_file(path).study, ["quantity=onset[dilation]"]).study
    assert code_version(chosen) != code_version(plain)
    # The folder has the settings too.
    assert main(["status", str(out)]) == 0
    assert main(["verify", str(out)]) == 0


def test_worker_processes_see_the_same(own, tmp_path):
    path = own(UNDECLARED)
    assert main(["run", str(path), "--workers", "1", "--out", str(tmp_path / "out")]) == 3
    assert all("extras=('onset[D]',)" in one for one in failures(tmp_path / "out"))
    path = own(OF_SETTING)
    words = ["--workers", "1", "--out", str(tmp_path / "two"), "--set", "quantity=onset[dilation]"]
    assert main(["run", str(path), *words]) == 0


def test_the_solver_of_large_networks_does_not_count(own, tmp_path, monkeypatch):
    monkeypatch.setattr("critflow.sparse.LARGE", (0, 0))
    path = own((VALUE, "from critflow.sparse import choose_backend\n    return len(choose_backend('auto', 10))"))
    assert run(path, tmp_path / "out") == 0
