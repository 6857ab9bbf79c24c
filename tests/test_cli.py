"""The command: exit codes, one sentence on stderr for every mistake, and a stdout for machines."""

import json
import re
import subprocess
import sys
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import pytest
import xarray as xr
from distributed import Client

from critflow.command.main import main
from critflow.engine import dask_workers

TINY = str(Path(__file__).parent / "engine" / "tiny_study.py")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A finished run of the tiny study; tests only read it."""
    folder = tmp_path_factory.mktemp("results")
    assert main(["run", TINY, "--out", str(folder), "--workers", "0"]) == 0
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with a study in ./workflows, and some files that are no results."""
    monkeypatch.chdir(tmp_path)
    source = Path(TINY).read_text()
    (tmp_path / "workflows").mkdir()
    (tmp_path / "workflows" / "tiny.py").write_text(source)
    (tmp_path / "text.txt").write_text("no study\n")
    (tmp_path / "other.py").write_text(source.replace('name="tiny"', 'name="other"'))
    (tmp_path / "alone.py").write_text(source.replace("check=check,", "check=check, workers=1,"))
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "study.json").write_text("{")
    (tmp_path / "folder").mkdir()
    return tmp_path


def test_a_run_by_name_writes_its_folder(here, capsys):
    assert main(["run", "tiny", "--workers", "0"]) == 0
    out, err = capsys.readouterr()
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
    entry = "\n  - ".join([*parts, "they are uniform below one"])
    assert f"- {entry}\n" in (folder / "claims.md").read_text()
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["count"], summary["nothing"]) == (4, None)
    assert sum(line.startswith("seed") for line in (folder / "run.log").read_text().splitlines()) == 8


MISTAKES = {  # words of the command, exit code, a word of the message
    "no command": ([], 2, "Missing"),
    "unknown command": (["rnu"], 2, "No such"),
    "unknown option": (["run", TINY, "--worker", "2"], 2, "No such"),
    "no study": (["run"], 2, "Missing"),
    "empty study": (["run", ""], 2, "name"),
    "two studies": (["run", TINY, TINY], 2, "extra"),
    "unknown study": (["run", "tinny"], 2, "'tiny'"),
    "folder as study": (["run", "folder/"], 2, "file"),
    "empty --out": (["run", TINY, "--out", ""], 2, "--out"),
    "unprintable --out": (["run", TINY, "--out", "a\nb"], 2, "--out"),
    "--out is a file": (["run", TINY, "--out", "text.txt"], 6, "is a file"),
    "--out below a file": (["run", TINY, "--workers=0", "--out", "text.txt/x"], 6, "write"),
    "--out of another study": (["run", "other.py", "--out", "RESULTS"], 2, "'tiny'"),
    "--workers as a word": (["run", TINY, "--workers", "many"], 2, "--workers"),
    "--workers negative": (["run", TINY, "--workers", "-1"], 2, "--workers"),
    "--workers of a study that measures time": (["run", "alone.py", "--workers", "2"], 2, "at most 1"),
    "--workers with a scheduler": (["run", TINY, "--scheduler", "tls://a:1", "--workers", "2"], 2, "--workers"),
    "--scheduler of a study that measures time": (["run", "alone.py", "--scheduler", "tls://a:1"], 2, "measures"),
    "--scheduler plain": (["run", TINY, "--scheduler", "tcp://127.0.0.1:9"], 2, "--insecure"),
    "--scheduler without certificates": (["run", TINY, "--scheduler", "tls://127.0.0.1:9"], 2, "certificates"),
    "--scheduler that does not answer": (["run", TINY, "--scheduler", "tcp://127.0.0.1:9", "--insecure"], 6, "answers"),
    "--time-limit zero": (["run", TINY, "--workers=1", "--time-limit", "0"], 2, "--time-limit"),
    "--time-limit NaN": (["run", TINY, "--workers=1", "--time-limit", "nan"], 2, "--time-limit"),
    "--time-limit without workers": (["run", TINY, "--workers=0", "--time-limit", "5"], 2, "--workers"),
    "--memory-limit negative": (["run", TINY, "--workers=1", "--memory-limit=-1"], 2, "--memory-limit"),
    "--memory-limit with a scheduler": (["run", TINY, "--memory-limit=5", "--scheduler=tls://h"], 2, "--memory-limit"),
    "--part": (["run", TINY, "--part", "1/4"], 2, "--scheduler ADDRESS"),
    "--cluster": (["run", TINY, "--cluster=slurm"], 2, "--scheduler ADDRESS"),
    "--jobs": (["run", TINY, "--jobs", "4"], 2, "--scheduler ADDRESS"),
    "--cluster with --jobs": (["run", TINY, "--cluster", "slurm", "--jobs=4"], 2, "dask-jobqueue"),
    "--set unknown": (["run", TINY, "--set", "sedes=3"], 2, "'seeds'"),
    "--set as an option of nothing": (["run", "--set", "seeds=1"], 2, "Missing"),
    "list an unknown study": (["list", "plane"], 2, "no study"),
    "status of nothing": (["status", "nowhere"], 2, "results folder"),
    "status of a file": (["status", "text.txt"], 2, "results folder"),
    "status of a damaged note": (["status", "damaged"], 4, "damaged"),
    "verify nothing": (["verify", "nowhere"], 2, "results folder"),
    "figures of nothing": (["figures", "nowhere"], 2, "results folder"),
    "figures in an unknown format": (["figures", "RESULTS", "--format", "gif"], 2, "svg"),
    "show nothing": (["show", "nowhere.nc"], 2, "run the study"),
    "show a folder": (["show", "folder"], 2, "folder"),
    "show a text": (["show", "text.txt"], 4, "text.txt"),
    "unknown option of show": (["show", "RESULTS/tiny.nc", "--seed", "1"], 2, "No such"),
}


def digest(folder):
    """Of every name and every content in a folder."""
    whole = sha256()
    for path in sorted(folder.rglob("*")):
        whole.update(str(path).encode() + (path.read_bytes() if path.is_file() else b""))
    return whole.hexdigest()


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_gives_its_exit_code_and_one_sentence_and_writes_nothing(here, results, capsys, monkeypatch, mistake):
    words, code, word = MISTAKES[mistake]
    soon = {"timeout": 0.3}
    monkeypatch.setattr(dask_workers, "Client", lambda *where, **options: Client(*where, **(options | soon)))
    before = digest(here)
    assert main([text.replace("RESULTS", str(results)) for text in words]) == code
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = [line for line in err.splitlines() if " cases in " not in line]
    assert line.startswith("critflow: ")
    assert word in line
    assert len(line) < 400
    assert digest(here) == before or "results" in {path.name for path in here.iterdir()}


@pytest.mark.parametrize("date", ["yesterday", "1e9", "-1", ""])
def test_a_malformed_date_is_refused_before_the_computation(here, capsys, monkeypatch, date):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", date)
    assert main(["run", "tiny", "--workers=0"]) == 2
    assert "SOURCE_DATE_EPOCH" in capsys.readouterr().err
    assert not (here / "results").exists()


def test_an_unexpected_error_is_one_line_and_its_traceback_on_request(results, capsys, monkeypatch):
    def surprise(*_):
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("critflow.engine.verify.verify_folder", surprise)
    assert main(["verify", str(results)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "ZeroDivisionError: by zero" in line
    monkeypatch.setenv("CRITFLOW_TRACEBACK", "1")
    assert main(["verify", str(results)]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_a_figure_that_fails_does_not_stop_the_claims(here, capsys):
    source = Path(TINY).read_text().replace("picture = Figure()", "raise ArithmeticError('no ink')")
    (here / "workflows" / "tiny.py").write_text(source)
    assert main(["run", "tiny", "--workers", "0"]) == 1
    err = capsys.readouterr().err
    assert "modulus" in err and "ArithmeticError: no ink" in err and "Traceback" not in err
    assert (here / "results" / "tiny" / "claims.md").exists()
    assert (here / "results" / "tiny" / "tiny.nc").exists()


def test_list_names_studies_and_those_that_do_not_load(here, capsys):
    (here / "workflows" / "broken.py").write_text("1 / 0")
    (here / "workflows" / "peer.py").write_text("import a_missing_package")
    assert main(["list"]) == 0
    out, err = capsys.readouterr()
    assert "tiny: A study without physics (4 seeds × 2 populations)" in out.splitlines()
    assert "ZeroDivisionError" in err
    assert "peer needs a_missing_package: pip install" in err


def test_list_prints_the_settings_of_a_study(here, capsys):
    assert main(["list", "tiny"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "tiny: A study without physics"
    assert any(line.startswith("  --set seeds=0:4: ") for line in lines)
    assert all(line.startswith("  --set ") for line in lines[1:])


def test_figures_of_a_stopped_run_show_its_complete_networks(here, capsys):
    assert main(["run", "tiny", "--workers", "0"]) == 0
    folder = here / "results" / "tiny"
    for path in [*sorted((folder / "shards").iterdir())[-2:], folder / "tiny.nc", folder / "figures" / "modulus.png"]:
        path.unlink()
    capsys.readouterr()
    assert main(["figures", str(folder)]) == 0
    assert "2 of 4 networks are complete" in capsys.readouterr().err
    assert (folder / "figures" / "modulus.png").exists()
    with xr.open_dataset(folder / "tiny.nc") as dataset:
        assert dataset.sizes["seed"] == 2
    # The same command completes the run.
    assert main(["run", "tiny", "--workers", "0"]) == 0
    with xr.open_dataset(folder / "tiny.nc") as dataset:
        assert dataset.sizes["seed"] == 4
    for path in [*(folder / "shards").iterdir(), folder / "tiny.nc"]:
        path.unlink()
    assert main(["figures", str(folder)]) == 2
    assert "0 of 4 networks" in capsys.readouterr().err


def test_figures_are_drawn_from_the_dataset_alone(here, capsys):
    assert main(["run", "tiny", "--workers", "0"]) == 0
    folder = here / "results" / "tiny"
    first = (folder / "figures" / "modulus.png").read_bytes()
    for path in [*(folder / "shards").iterdir(), folder / "figures" / "modulus.png"]:
        path.unlink()
    assert main(["figures", str(folder)]) == 0
    assert (folder / "figures" / "modulus.png").read_bytes() == first
    assert main(["figures", str(folder), "--format", "pdf"]) == 0
    assert (folder / "figures" / "modulus.pdf").read_bytes().startswith(b"%PDF")
    assert "Of 2 statements of ours that this study tests, 1 holds and 1 differs" in capsys.readouterr().out


def test_version_and_help(capsys):
    """The module is the command too."""
    words = [sys.executable, "-m", "critflow", "--version"]
    assert subprocess.run(words, capture_output=True, text=True).stdout == f"critflow {version('critflow')}\n"
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"critflow {version('critflow')}\n"
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(command in out for command in ("run", "list", "status", "verify", "figures", "show"))


def test_help_is_written_for_users(capsys):
    """Neither sentences for developers, nor types of Python, nor lines that are cut short."""
    assert main(["--help"]) == 0
    listed = capsys.readouterr().out.partition("Commands:")[2]
    assert "..." not in listed
    commands = [line.split()[0] for line in listed.splitlines() if line.startswith("  ")]
    assert commands[0] == "run"
    for name in commands[: commands.index("critflow")]:
        assert main([name, "--help"]) == 0
        text = capsys.readouterr().out
        assert not re.search("parameter|function|module|docstring|Path|INTEGER|FLOAT|TEXT|<[a-z]", text), text
        assert all(len(line) <= 80 for line in text.splitlines())
