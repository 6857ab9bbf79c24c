"""The extra and the population of `docs/extending.md`, in a copy of the package of which nothing else changes."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import xarray as xr
from test_docs import DOCS, blocks, is_of_the_package
from test_extras import ROOT, without


def test_the_extra_of_the_documents_is_one_folder(tmp_path):
    """The page has its files, its tests, and what its command prints."""
    page = blocks(DOCS / "extending.md")
    folder, files = without(tmp_path), [block for block in page if is_of_the_package(block)]
    for block in files:
        (folder / block.file).parent.mkdir(parents=True, exist_ok=True)
        (folder / block.file).write_text(block.text, encoding="utf-8")
    names = {Path(block.file).parts[2] for block in files}
    assert names == {"poisson"} and {Path(block.file).parts[1] for block in files} == {"extras"}
    assert 40 <= sum(block.text.count("\n") for block in files if block.file.startswith("critflow")) <= 60
    command, printed = next(block.text for block in page if block.kind == "text").splitlines()
    for words, expected in (
        (["critflow", *command.split()[2:]], printed),
        (["critflow", "--help"], "Print Poisson's ratio of the stiffest critical configuration."),
        (["pytest", "-p", "no:cacheprovider", *(block.file for block in files if "test_" in block.file)], "2 passed"),
    ):
        line = [sys.executable, "-W", "error", "-m", *words]
        done = subprocess.run(line, cwd=folder, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0 and expected in done.stdout, done.stdout[-2000:] + done.stderr[-2000:]


def test_the_population_of_the_documents_is_one_entry(tmp_path):
    """Behind the last one it has a label, a colour and numbers in the ensemble, and is drawn."""
    entry = next(block.text for block in blocks(DOCS / "extending.md") if block.file == "entry.py")
    folder = without(tmp_path)
    (folder / "workflows").unlink()
    shutil.copytree(ROOT / "workflows", folder / "workflows", ignore=shutil.ignore_patterns("__pycache__"))
    module = folder / "workflows" / "shared" / "populations.py"
    lines = module.read_text(encoding="utf-8").splitlines(keepends=True)
    calls = [node for node in ast.walk(ast.parse("".join(lines))) if isinstance(node, ast.Call)]
    lines.insert(max(c.end_lineno for c in calls if getattr(c.func, "id", "") == "Population"), entry)
    module.write_text("".join(lines), encoding="utf-8")
    words = ("seeds=0:2", "n_vertices=20", "strains=0.001:0.003:0.001")
    command = [sys.executable, "-W", "error", "-m", "critflow", "run", "ensemble", "--workers", "0", "--out", "out"]
    done = subprocess.run([*command, *(f"--set={word}" for word in words)], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    one = xr.load_dataset(folder / "out" / "ensemble.nc").isel(population=-1)
    assert (str(one.population.values), one.population.size) == ("lognormal_stress", 1)
    assert (str(one.population_label.values), str(one.population_color.values)) == ("log-normal σ", "#000000")
    assert np.isfinite(one.B_0).all() and len(list((folder / "out" / "figures").glob("*.png"))) == 3
