"""Sentences that users get for mistakes: the machinery of `test_mistakes.py` in both suites."""

from pathlib import Path

import numpy as np
import pytest
from distributed import Client
from fixtures import TINY
from refusals import of_bounded_length

import critflow as cf
from critflow import CritflowError
from critflow.command.main import main
from critflow.engine import dask_workers

NETWORK = cf.voronoi_network(n_vertices=60, seed=1)
MANIFOLD = cf.CriticalManifold(NETWORK)
BEST = cf.optimize(NETWORK, "B_0")
CRITICAL = BEST.value
STATE = cf.spring_state(NETWORK, CRITICAL.lengths, CRITICAL.coordinates)
FAILED = cf.CriticalManifold(cf.three_bar_linkage()).solve([1, 1, -0.5])
# Lengths at which edges are slack.
WIDE = np.abs(1 + 0.5 * np.random.default_rng(0).standard_normal(90))
MAKES_ONE = "CriticalManifold(network).configuration(sigma) or optimize(network, 'B_0') makes one"


def give_their_sentences(calls):
    """The test of a table of wrong calls: call, kind of error, words of the sentence."""

    @pytest.mark.parametrize("name", calls)
    def test(name, monkeypatch, tmp_path):
        monkeypatch.chdir(tmp_path)
        call, kind, *words = calls[name]
        with pytest.raises(kind) as caught:
            call()
        sentence = str(caught.value)
        assert [word for word in words if word not in sentence] == [], sentence
        if isinstance(caught.value, CritflowError):
            assert of_bounded_length(caught.value, 400)
        assert list(tmp_path.iterdir()) == []

    return test


def contents(folder):
    """The bytes of the files in a folder, by path; None of a folder in it."""
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def give_their_codes_and_sentences(commands, longest=1000, silent=False):
    """The test of a table of wrong commands: words of the command, exit code, words of the sentence.

    longest  number of letters of a sentence
    silent   whether nothing is written to stdout
    """

    @pytest.mark.parametrize("name", commands)
    def test(name, here, results, capsys, monkeypatch):
        words, code, *decisive = commands[name]
        monkeypatch.setattr(dask_workers, "Client", lambda *where, **more: Client(*where, **(more | {"timeout": 0.3})))
        before = contents(here)
        capsys.readouterr()
        assert main([word.replace("RESULTS", str(results)) for word in words]) == code
        out, err = capsys.readouterr()
        # A run says how many cases it begins.
        (line,) = [line for line in err.splitlines() if " cases in " not in line]
        assert line.startswith("critflow: ") and len(line) < longest and not (silent and out), (out, line)
        assert [word for word in decisive if word not in line] == [], line
        # A run makes its folder before it looks for the scheduler.
        late = "--scheduler that does not answer", "--scheduler without certificates"
        assert contents(here) == before or name in late

    return test


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with two studies, a network without a boundary, and files that are no results."""
    monkeypatch.chdir(tmp_path)
    source = Path(TINY).read_text()
    (tmp_path / "other.py").write_text(source.replace('name="tiny"', 'name="other"'))
    (tmp_path / "alone.py").write_text(source.replace("check=check,", "check=check, workers=1,"))
    (tmp_path / "star_edges.csv").write_text("tail,head\nA,D\nB,D\nC,D\n")
    (tmp_path / "star_vertices.csv").write_text("id,x,y\nA,0,0\nB,4,0\nC,0,3\nD,1,1\n")
    (tmp_path / "text.txt").write_text("no study\n")
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "study.json").write_text("{")
    (tmp_path / "folder").mkdir()
    return tmp_path
