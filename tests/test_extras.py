"""The two rings: an extra is one folder, and without it everything else works.

`.ci/extras` also runs all other tests without each of them in turn.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from extras_there import PACKAGE, PUBLIC, absent, skip_without, used_by_file

from critflow.extensions import extras, with_needs

ROOT = PACKAGE.parent
TESTS = Path(__file__).parent

# The package is imported, prints its help, and computes a small ensemble with its figures and claims.
PROGRAM = """
import sys
from pathlib import Path
import critflow
assert Path(critflow.__file__).parent == Path.cwd() / "critflow", critflow.__file__
from critflow.command.main import main
assert main(["--help"]) == 0
settings = ["seeds=0:1", "n_vertices=20", "strains=0.001:0.003:0.001"]
code = main(["run", "ensemble", "--workers", "0", "--out", "out", *(f"--set={one}" for one in settings)])
assert code == 0 and Path("out/ensemble.nc").stat().st_size > 10_000
print("loaded:", *sorted({name.split(".")[2] for name in sys.modules if name.startswith("critflow.extras.")}))
"""


def without(folder: Path, *names: str) -> Path:
    """A copy of the package without these extras, with the studies."""
    leave = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE, folder / "critflow", ignore=leave)
    for name in names:
        shutil.rmtree(folder / "critflow" / "extras" / name)
    (folder / "workflows").symlink_to(ROOT / "workflows")
    return folder


# A design of stresses, and one of rest lengths, which are an extra that imports that of cables.
DESIGNS = """
import critflow as cf
network = cf.voronoi_network(20, seed=1)
assert cf.design(network, {"B_0": 0.2}).ok
try:
    cf.design(network, {"B_0": 0.2}, change="rest_lengths")
except cf.InputError as error:
    print(error)
"""


def executed(folder: Path, program: str = PROGRAM) -> str:
    command = [sys.executable, "-W", "error", "-c", program]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


@pytest.mark.parametrize("name", extras())
def test_without_an_extra_the_package_works(name, tmp_path):
    printed = executed(without(tmp_path, name))
    commands = {line.split()[0] for line in printed.partition("Commands:")[2].splitlines() if line.startswith("  ")}
    assert {"run", "list", "verify"} <= commands
    assert not commands & extras()[name].commands.keys()


@pytest.mark.parametrize("name", ["cables", "design_rest_lengths"])
def test_without_a_change_the_others_work(name, tmp_path):
    skip_without(["targets", "cables", "design_rest_lengths"])
    printed = executed(without(tmp_path, name), DESIGNS)
    assert f"the extra '{name}'" in printed and "which is not installed" in printed


def test_without_all_extras_the_package_works(tmp_path):
    assert "loaded:\n" in executed(without(tmp_path, *extras()))


def test_the_ensemble_loads_no_extra(tmp_path):
    assert "loaded:\n" in executed(without(tmp_path))


def test_every_folder_declares_itself_and_has_tests():
    folders = {path.name for path in (PACKAGE / "extras").iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders == set(extras())
    for name, extra in extras().items():
        assert name not in extra.needs
        assert list((TESTS / "extras" / name).glob("test_*.py")), name


def test_extras_do_not_need_each_other_in_a_circle():
    for name, extra in extras().items():
        assert name not in with_needs(set(extra.needs)), name


# Whose subject is the whole repository: these leave out what is not there.
OF_ALL = ("studies", "benchmarks", "pages", "extras")

# Tables of which a row for an extra is left out with it, and comparisons, which are left out as a whole.
WITH_TABLES = {"test_arguments.py", "test_imports.py", "test_mistakes.py", "test_peers.py"}


def test_tests_of_the_scene_use_no_extra():
    files = [path for path in TESTS.rglob("*.py") if path.relative_to(TESTS).parts[0] not in OF_ALL]
    assert {str(path.relative_to(TESTS)) for path in files if used_by_file(path)} <= WITH_TABLES


def test_every_public_name_of_an_extra_is_tested_in_its_folder():
    for name, extra in ((name, extra) for name, extra in PUBLIC.items() if not absent([extra])):
        files = (TESTS / "extras" / extra).glob("test_*.py")
        assert any(re.search(rf"\b{name}\b", path.read_text(encoding="utf-8")) for path in files), f"{extra}: {name}"
