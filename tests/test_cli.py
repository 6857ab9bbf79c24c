"""The command: exit codes, one sentence on stderr for every mistake, and a stdout for machines."""

import json
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import xarray as xr
from fixtures import TINY

from critflow.command.main import main


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with a study in ./workflows."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "workflows").mkdir()
    (tmp_path / "workflows" / "tiny.py").write_text(Path(TINY).read_text())
    return tmp_path


def test_a_run_by_name_writes_its_folder(here, said):
    out, err = said(["run", "tiny", "--workers", "0"])
    lines = out.splitlines()
    assert (lines[0].split(":")[0], len(lines)) == ("results/tiny/tiny.nc", 4)
    assert "The dataset is complete." in out
    assert "Of 2 statements of ours that this study tests, 1 holds and 1 differs: see" in out
    assert "8/8 cases" in err.splitlines()[-3]
    assert ["dataset" in err.splitlines()[-2], "figures" in err.splitlines()[-1]] == [True, True]
    folder = here / "results" / "tiny"
    files = {"tiny.nc", "claims.md", "claims.json", "summary.json", "study.json", "run.log", ".lock"}
    assert {path.name for path in folder.iterdir()} == files | {"figures", "shards", "failed"}
    assert (folder / "figures" / "modulus.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "figures" / "growth.gif").read_bytes().startswith(b"GIF89a")
    claims = json.loads((folder / "claims.json").read_text())
    assert [claim["verdict"] for claim in claims] == ["holds", "measured", "differs"]
    parts = ["residuals | are large: **differs**", "measured: 0.5 (4 networks)", "printed: 7", "criterion: = 7"]
    entry = "\n  - ".join([*parts, "remark: they are uniform below one"])
    assert f"- {entry}\n" in (folder / "claims.md").read_text()
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["count"], summary["nothing"]) == (4, None)
    assert sum(line.startswith("seed") for line in (folder / "run.log").read_text().splitlines()) == 8


@pytest.mark.parametrize("date", ["yesterday", "1e9", "-1", ""])
def test_a_malformed_date_is_refused_before_the_computation(here, said, monkeypatch, date):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", date)
    assert "SOURCE_DATE_EPOCH" in said(["run", "tiny", "--workers=0"], 2).err
    assert not (here / "results").exists()


def test_an_unexpected_error_is_one_line_and_its_traceback_on_request(tmp_path, said, monkeypatch):
    def surprise(*_):
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("critflow.engine.verify.verify_folder", surprise)
    (line,) = said(["verify", str(tmp_path)], 1).err.splitlines()
    assert "ZeroDivisionError: by zero" in line
    monkeypatch.setenv("CRITFLOW_TRACEBACK", "1")
    assert "Traceback" in said(["verify", str(tmp_path)], 1).err


def test_a_figure_that_fails_does_not_stop_the_claims(here, said):
    source = Path(TINY).read_text().replace("picture = Figure()", "raise ArithmeticError('no ink')")
    (here / "workflows" / "tiny.py").write_text(source)
    err = said(["run", "tiny", "--workers", "0"], 1).err
    assert "modulus" in err and "ArithmeticError: no ink" in err and "Traceback" not in err
    assert (here / "results" / "tiny" / "claims.md").exists()
    assert (here / "results" / "tiny" / "tiny.nc").exists()


def test_list_names_studies_and_those_that_do_not_load(here, said):
    (here / "workflows" / "broken.py").write_text("1 / 0")
    (here / "workflows" / "peer.py").write_text("import a_missing_package")
    out, err = said(["list"])
    assert "tiny: A study without physics (4 seeds × 2 populations)" in out.splitlines()
    assert "ZeroDivisionError" in err
    assert "peer needs a_missing_package: pip install" in err


def test_list_prints_the_settings_of_a_study(here, said):
    lines = said(["list", "tiny"]).out.splitlines()
    assert lines[0] == "tiny: A study without physics"
    assert any(line.startswith("  --set seeds=0:4: ") for line in lines)
    assert all(line.startswith("  --set ") for line in lines[1:])


def test_figures_of_a_stopped_run_show_its_complete_networks(here, said):
    assert main(["run", "tiny", "--workers", "0"]) == 0
    folder = here / "results" / "tiny"
    for path in [*sorted((folder / "shards").iterdir())[-2:], folder / "tiny.nc", folder / "figures" / "modulus.png"]:
        path.unlink()
    assert "2 of 4 networks are complete" in said(["figures", str(folder)]).err
    assert (folder / "figures" / "modulus.png").exists()
    with xr.open_dataset(folder / "tiny.nc") as dataset:
        assert dataset.sizes["seed"] == 2
    # The same command completes the run.
    assert main(["run", "tiny", "--workers", "0"]) == 0
    with xr.open_dataset(folder / "tiny.nc") as dataset:
        assert dataset.sizes["seed"] == 4
    for path in [*(folder / "shards").iterdir(), folder / "tiny.nc"]:
        path.unlink()
    assert "0 of 4 networks" in said(["figures", str(folder)], 2).err


def test_figures_are_drawn_from_the_dataset_alone(here, said):
    assert main(["run", "tiny", "--workers", "0"]) == 0
    folder = here / "results" / "tiny"
    first = (folder / "figures" / "modulus.png").read_bytes()
    for path in [*(folder / "shards").iterdir(), folder / "figures" / "modulus.png"]:
        path.unlink()
    assert main(["figures", str(folder)]) == 0
    assert (folder / "figures" / "modulus.png").read_bytes() == first
    printed = said(["figures", str(folder), "--format", "pdf"]).out
    assert "Of 2 statements of ours that this study tests, 1 holds and 1 differs" in printed
    assert (folder / "figures" / "modulus.pdf").read_bytes().startswith(b"%PDF")


def test_version_and_help(said):
    """The module is the command too."""
    words = [sys.executable, "-m", "critflow", "--version"]
    assert subprocess.run(words, capture_output=True, text=True).stdout == f"critflow {version('critflow')}\n"
    assert said(["--version"]).out == f"critflow {version('critflow')}\n"
    out = said(["--help"]).out
    assert all(command in out for command in ("run", "list", "status", "verify", "figures", "show"))


def test_help_is_written_for_users(said):
    """Neither sentences for developers, nor types of Python, nor lines that are cut short."""
    listed = said(["--help"]).out.partition("Commands:")[2]
    assert "..." not in listed
    commands = [line.split()[0] for line in listed.splitlines() if line.startswith("  ")]
    assert commands[0] == "run"
    for name in commands[: commands.index("critflow")]:
        text = said([name, "--help"]).out
        assert not re.search("parameter|function|module|docstring|Path|INTEGER|FLOAT|TEXT|<[a-z]", text), text
        assert all(len(line) <= 80 for line in text.splitlines())
