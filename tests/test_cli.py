"""The command: exit codes, one sentence on stderr for every mistake, and a stdout for machines."""

import json
import os
import pty
import signal
import subprocess
import sys
import types
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from critflow.cli import main
from critflow.workflow import workers

TINY = str(Path(__file__).parent / "workflow" / "tiny_study.py")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A finished run of the tiny study; tests only read it."""
    folder = tmp_path_factory.mktemp("results")
    assert main(["run", TINY, "--out", str(folder), "--workers", "0"]) == 0
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty working directory with one study of its own in ./workflows."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "workflows").mkdir()
    (tmp_path / "workflows" / "tiny.py").write_bytes(Path(TINY).read_bytes())
    return tmp_path


def test_a_run_by_name_writes_its_folder_and_says_so(here, capsys):
    assert main(["run", "tiny", "--workers", "0"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        "results/tiny/tiny.nc: 4 seeds × 2 populations, 0 of 8 cases were there before",
        "results/tiny/figures: modulus, growth",
        "results/tiny/claims.md: 1 of 2 claims hold",
    ]
    assert err.splitlines()[0] == "tiny: 4 networks, 8 cases to compute in this process"
    assert "4/4 networks" in err.splitlines()[-1]
    folder = here / "results" / "tiny"
    names = {path.name for path in folder.iterdir()}
    assert names == {
        *(
            "tiny.nc",
            "figures",
            "claims.md",
            "claims.json",
            "summary.json",
            "manifest.json",
            "shards",
            "shards.index",
            "study.json",
            "run.log",
            ".lock",
        )
    }
    assert (folder / "figures" / "modulus.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "figures" / "growth.gif").read_bytes().startswith(b"GIF89a")
    claims = json.loads((folder / "claims.json").read_text())
    assert [claim["verdict"] for claim in claims] == ["holds", "measured", "differs"]
    assert "| large | residuals \\| are large | 7 | 0.5 | differs |" in (folder / "claims.md").read_text()
    assert "**large** differs: they are uniform below one" in (folder / "claims.md").read_text()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["count"] == 4
    assert summary["nothing"] is None
    assert 0 < summary["largest"] < 1
    log = (folder / "run.log").read_text().splitlines()
    assert sum(line.startswith("seed") for line in log) == 8


def test_a_dry_run_writes_nothing(here, capsys):
    before = sorted(here.rglob("*"))
    assert main(["run", "tiny", "--dry-run", "--set", "seeds=0:3"]) == 0
    out = capsys.readouterr().out
    assert "6 of 6 cases to compute, into results/tiny" in out
    assert "strains = 0.001,0.002,0.003" in out
    assert sorted(here.rglob("*")) == before


def test_a_dry_run_counts_what_is_there(results, capsys):
    assert main(["run", TINY, "--dry-run", "--out", str(results), "--set", "seeds=0:6"]) == 0
    assert "4 of 12 cases to compute" in capsys.readouterr().out


MISTAKES = {
    "no command": ([], 2, "Missing command"),
    "unknown command": (["rnu"], 2, "No such command"),
    "unknown option": (["run", TINY, "--worker", "2"], 2, "No such option"),
    "no study": (["run"], 2, "Missing argument"),
    "workers not a number": (["run", TINY, "--workers", "many"], 2, "--workers"),
    "negative workers": (["run", TINY, "--workers", "-1"], 2, "--workers -1"),
    "workers of a study that measures": (["run", "alone.py", "--workers", "2"], 2, "give at most 1"),
    "scheduler of a study that measures": (["run", "alone.py", "--scheduler", "tls://x:1"], 2, "leave it out"),
    "unknown study": (["run", "tinny"], 2, "did you mean 'tiny'"),
    "missing file": (["run", "nowhere.py"], 2, "cannot read the study file"),
    "study with an error": (["run", "broken.py"], 2, "ZeroDivisionError"),
    "unknown setting": (["run", TINY, "--set", "sedes=3"], 2, "did you mean 'seeds'"),
    "no value": (["run", TINY, "--set", "seeds"], 2, "has no value"),
    "zero seeds": (["run", TINY, "--set", "seeds=0:0"], 2, "empty range"),
    "unknown population": (["run", TINY, "--set", "populations=flopy"], 2, "did you mean 'floppy'"),
    "backwards strains": (["run", TINY, "--set", "strains=0.3:0.1:0.1"], 2, "backwards"),
    "odd edges": (["run", TINY, "--set", "n_edges=7"], 2, "even number"),
    "another study's folder": (["run", "other.py", "--out", "RESULTS"], 2, "holds study 'tiny', not 'other'"),
    "out is a file": (["run", TINY, "--out", "broken.py"], 6, "is a file"),
    "out cannot be made": (["run", TINY, "--workers", "0", "--out", "/proc/nowhere/x"], 6, "cannot write"),
    "out below a file": (["run", TINY, "--workers", "0", "--out", "broken.py/x"], 6, "cannot write"),
    "no scheduler": (["run", TINY, "--scheduler", "tcp://127.0.0.1:9", "--insecure"], 6, "no scheduler answers"),
    "bad scheduler": (["run", TINY, "--scheduler", "what://is this"], 2, "must begin with tls://"),
    "status of nothing": (["status", "nowhere"], 2, "not a results folder"),
    "figures of nothing": (["figures", "nowhere"], 2, "not a results folder"),
    "unknown format": (["figures", "RESULTS", "--format", "gif"], 2, "png, pdf, svg"),
    "damaged note": (["status", "damaged"], 4, "run the study again to write it anew"),
    "show nothing": (["show", "nowhere.nc"], 2, "run the study first"),
    "show no dataset": (["show", "broken.py"], 4, "not a readable dataset"),
    "show unknown axis": (["show", "RESULTS/tiny.nc", "--set", "sed=1"], 2, "did you mean 'seed'"),
    "show unknown value": (["show", "RESULTS/tiny.nc", "--set", "population=flopy"], 2, "did you mean 'floppy'"),
    "show which": (["show", "RESULTS/tiny.nc", "--set", "seed=1"], 2, "which population?"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_gets_its_exit_code_and_one_sentence(here, results, capsys, monkeypatch, mistake):
    words, code, sentence = MISTAKES[mistake]
    monkeypatch.setattr(workers, "_SCHEDULER_ANSWERS", 0.3)
    (here / "broken.py").write_text("1 / 0")
    (here / "other.py").write_text(Path(TINY).read_text().replace('name="tiny"', 'name="other"'))
    (here / "alone.py").write_text(Path(TINY).read_text().replace("check=check,", "check=check, workers=1,"))
    (here / "damaged").mkdir()
    (here / "damaged" / "study.json").write_text("{")
    before = sorted(here.rglob("*"))
    assert main([word.replace("RESULTS", str(results)) for word in words]) == code
    out, err = capsys.readouterr()
    assert out == ""
    lines = [line for line in err.splitlines() if "cases to compute" not in line]
    assert len(lines) == 1, err
    assert lines[0].startswith("critflow: ")
    assert sentence in lines[0]
    left = [path for path in sorted(here.rglob("*")) if path not in before and "results" not in path.parts]
    assert left == []  # a mistake leaves nothing behind


def test_an_unexpected_error_is_one_line_and_its_traceback_on_demand(results, capsys, monkeypatch):
    def surprise(*_):
        raise ZeroDivisionError("by nought")

    monkeypatch.setattr("critflow.cli.folder_status", surprise)
    assert main(["status", str(results)]) == 1
    err = capsys.readouterr().err
    assert err == "critflow: unexpected ZeroDivisionError: by nought: set CRITFLOW_TRACEBACK=1 to see where\n"
    monkeypatch.setenv("CRITFLOW_TRACEBACK", "1")
    assert main(["status", str(results)]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_a_figure_that_fails_keeps_the_claims(here, capsys):
    source = Path(TINY).read_text().replace("picture = Figure()", "raise ArithmeticError('no ink')")
    (here / "workflows" / "tiny.py").write_text(source)
    assert main(["run", "tiny", "--workers", "0"]) == 1
    expected = "critflow: figure 'modulus' could not be made (and 1 more): ArithmeticError: no ink"
    assert expected in capsys.readouterr().err
    assert (here / "results" / "tiny" / "claims.md").exists()
    assert (here / "results" / "tiny" / "tiny.nc").exists()


def test_list_names_studies_and_those_that_do_not_load(here, capsys):
    (here / "workflows" / "broken.py").write_text("1 / 0")
    assert main(["list"]) == 0
    out, err = capsys.readouterr()
    assert "tiny: A study without physics (4 seeds × 2 populations)" in out.splitlines()
    assert "ZeroDivisionError" in err


def test_status_counts_and_names_damage(here, capsys):
    run = ["run", TINY, "--workers", "0", "--out", "out", "--set", "trouble=1-random"]
    assert main(run) == 3
    shards = sorted((here / "out" / "shards").iterdir())
    shards[-1].write_bytes(shards[-1].read_bytes()[:-1])
    shards[0].unlink()
    capsys.readouterr()
    assert main(["status", "out"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        "tiny: 5 done, 1 failed, 1 missing, 1 damaged of 8 cases",
        "  seed 0: 1 done, 1 missing",
        "  seed 1: 1 done, 1 failed",
        "  seed 2: 2 done",
        "  seed 3: 1 done, 1 damaged",
        "  population random: 2 done, 1 failed, 1 damaged",
        "  population floppy: 3 done, 1 missing",
        "  failed: seed 1, population random: asked for",
        "  missing: seed 0, population floppy: not computed yet",
        "  damaged: seed 3, population random: is cut short or not a shard: its seal is missing",
    ]
    assert err.count("critflow: ") == 1
    assert shards[-1].name in err


def test_status_joins_what_stands_alike(results, capsys):
    assert main(["status", str(results)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "tiny: 8 done of 8 cases",
        "  seed 0:4: 2 done each",
        "  population random,floppy: 4 done each",
    ]


def test_figures_are_drawn_anew_from_the_dataset_alone(here, capsys):
    assert main(["run", "tiny", "--workers", "0"]) == 0
    folder = here / "results" / "tiny"
    first = (folder / "figures" / "modulus.png").read_bytes()
    for path in (folder / "shards").iterdir():
        path.unlink()
    assert main(["figures", str(folder)]) == 0
    assert (folder / "figures" / "modulus.png").read_bytes() == first
    assert main(["figures", str(folder), "--format", "pdf"]) == 0
    assert (folder / "figures" / "modulus.pdf").read_bytes().startswith(b"%PDF")
    assert "1 of 2 claims hold" in capsys.readouterr().out


def test_a_damaged_dataset_is_told(here, capsys):
    assert main(["run", "tiny", "--workers", "0"]) == 0
    path = here / "results" / "tiny" / "tiny.nc"
    path.write_bytes(path.read_bytes()[:-500])
    assert main(["figures", "results/tiny"]) == 4
    assert "critflow: results/tiny/tiny.nc is not a readable dataset" in capsys.readouterr().err


def test_show_hands_one_case_to_the_drawing(results, tmp_path, capsys, monkeypatch):
    seen = []
    fake = types.ModuleType("critflow.workflow.show")
    fake.show_configuration = lambda case, path: seen.append((case.load(), path)) or "one configuration"
    monkeypatch.setitem(sys.modules, "critflow.workflow.show", fake)
    words = ["show", str(results / "tiny.nc"), "--set", "seed=2", "--set", "population=random"]
    assert main([*words, "--out", str(tmp_path / "a.png")]) == 0
    assert main(words) == 0
    assert capsys.readouterr().out == "one configuration\n" * 2
    (case, path), (_, named) = seen
    assert (path, named) == (tmp_path / "a.png", Path("seed-2-population-random.png"))
    assert case.sigma.dims == ("edge",)
    assert np.isfinite(case.sigma).all()
    assert (int(case.seed), str(case.population.values)) == (2, "random")


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"critflow {version('critflow')}\n"


def test_help_names_every_command(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(command in out for command in ("run", "list", "status", "figures", "show"))


def test_help_and_mistakes_do_not_wait_for_heavy_libraries():
    code = "import sys, critflow.cli; print([m for m in ('xarray', 'distributed', 'matplotlib') if m in sys.modules])"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


def test_on_a_terminal_there_is_a_bar_on_stderr_and_nothing_else_on_stdout(tmp_path):
    driver, terminal = pty.openpty()
    code = "import sys; from critflow.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", code, "run", TINY, "--out", str(tmp_path), "--workers", "0"]
    environment = os.environ | {"TERM": "xterm", "NO_COLOR": "1", "COLUMNS": "120"}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=terminal, text=True, env=environment)
    os.close(terminal)
    seen = b""
    while chunk := _read(driver):
        seen += chunk
    out = process.communicate()[0]
    assert process.returncode == 0
    assert "4/4 networks" in seen.decode()
    assert "━" in seen.decode()
    assert b"\x1b[3" not in seen  # no colour
    assert len(out.splitlines()) == 3


def _read(driver):
    try:
        return os.read(driver, 4096)
    except OSError:  # what Linux answers when the other end of a terminal is closed
        return b""


def test_the_module_is_the_command(tmp_path):
    words = [sys.executable, "-m", "critflow", "run", TINY, "--out", str(tmp_path / "out"), "--workers", "1"]
    told = subprocess.run(words, capture_output=True, text=True, timeout=100)
    assert told.returncode == 0, told.stderr
    assert (tmp_path / "out" / "tiny.nc").exists()


def test_an_interrupt_while_the_command_is_imported_says_nothing():
    code = (
        "import os, signal, critflow.__main__ as command\n"
        "command.import_module = lambda name: os.kill(os.getpid(), signal.SIGINT)\n"
        "command.main()"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert (ended.returncode, ended.stderr) == (-signal.SIGINT, "")


def test_much_damage_is_told_in_few_lines(here, capsys):
    words = ["run", "tiny", "--workers", "0", "--set", "seeds=0:15"]
    assert main(words) == 0
    for shard in (here / "results" / "tiny" / "shards").glob("*.nc"):
        shard.write_bytes(b"")
    (here / "results" / "tiny" / "shards.index").unlink()
    for command, more in ((["status", "results/tiny"], "verify results/tiny names all"), (words, "again too")):
        capsys.readouterr()
        assert main(command) == 0
        err = capsys.readouterr().err
        assert err.count("its seal is missing") == 20
        assert "and 10 more" in err
        assert more in err
