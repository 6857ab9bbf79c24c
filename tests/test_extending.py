"""What `docs/extending.md` says of files outside the page: an eighth population, and a package that joins.

Its other blocks are executed by `test_docs.py`.
"""

import ast
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from test_docs import DOCS, blocks

ROOT = DOCS.parent
PAGE = blocks(DOCS / "extending.md")
FILES = {block.file: block.text for block in PAGE if block.file}


def run(*words, cwd, **environment):
    """What a command line prints in a new process, with warnings as errors."""
    line = [sys.executable, "-W", "error", "-m", *words]
    done = subprocess.run(
        line, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


@pytest.fixture
def checkout(tmp_path):
    """A copy of the package and of its studies, from which `python -m critflow` imports."""
    for folder in ("critflow", "workflows"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_an_eighth_population_is_one_entry(checkout):
    """It stands last, has a label, a colour and numbers in the ensemble, and is drawn."""
    module = checkout / "workflows" / "shared" / "populations.py"
    lines = module.read_text(encoding="utf-8").splitlines(keepends=True)
    calls = [node for node in ast.walk(ast.parse("".join(lines))) if isinstance(node, ast.Call)]
    lines.insert(max(one.end_lineno for one in calls if getattr(one.func, "id", "") == "Population"), FILES["entry.py"])
    module.write_text("".join(lines), encoding="utf-8")
    settings = [f"--set={word}" for word in ("seeds=0:2", "n_vertices=20", "strains=0.001:0.003:0.001")]
    run("critflow", "run", "ensemble", "--workers", "0", "--out", "out", *settings, cwd=checkout)
    whole = xr.load_dataset(checkout / "out" / "ensemble.nc")
    one = whole.isel(population=-1)
    assert (whole.sizes["population"], str(one.population.values)) == (8, "lognormal_stress")
    assert (str(one.population_label.values), str(one.population_color.values)) == ("log-normal σ", "#000000")
    assert np.isfinite(one.B_0).all() and len(list((checkout / "out" / "figures").glob("*.png"))) == 3


def installed(folder: Path) -> None:
    """What `pip install .` adds to a folder of packages, written here since the backend may not be installed."""
    project = tomllib.loads(FILES["pyproject.toml"])["project"]
    (folder / f"{project['name']}.py").write_text(FILES[f"{project['name']}.py"], encoding="utf-8")
    metadata = folder / f"{project['name']}-{project['version']}.dist-info"
    metadata.mkdir(parents=True)
    text = "Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n".format(**project)
    (metadata / "METADATA").write_text(text, encoding="utf-8")
    groups = project["entry-points"].items()
    lines = [line for group, names in groups for line in (f"[{group}]", *(f"{a} = {b}" for a, b in names.items()))]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_a_package_joins_by_its_entry_points(tmp_path):
    """Its command prints what the page shows, `--help` lists it, and its quantity stands wherever a name does."""
    (tmp_path / "site").mkdir()
    installed(tmp_path / "site")
    shown = next(block.text for block in PAGE if block.kind == "text")
    command, printed = shown.splitlines()
    there = {"cwd": tmp_path, "PYTHONPATH": str(tmp_path / "site")}
    assert run("critflow", *command.split()[2:], **there) == printed + "\n"
    assert "Print the localisation of the stress in an optimum." in run("critflow", "--help", **there)
    (tmp_path / "least.py").write_text(
        "import critflow as cf\n"
        "best = cf.optimize(cf.voronoi_network(20, seed=1), 'localisation', method='newton')\n"
        "print(round(best.objective, 12), best.status)\n"
    )
    assert run("least", **there) == "1.0 ok\n"  # equal stresses, by second derivatives of the class
