"""The page of results: every label of the paper once, functions, tests and results that exist, text up to date."""

import ast
import importlib
import json
import re
import subprocess
from pathlib import Path

import pytest

from critflow.engine.code_digest import load_study, named_studies
from workflows.pages.packages import CRITFLOW
from workflows.pages.paper import EQUATIONS, FIGURES, printed
from workflows.pages.results import rendered, studies

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "results" / "README.md"
OF_THE_SCENE = [equation for equation in EQUATIONS if not equation.function.startswith("critflow_extras.")]


def test_every_label_stands_once():
    labels = [equation.label for equation in EQUATIONS]
    assert len(set(labels)) == len(labels)
    # The source has 53 labelled equations and 8 labelled figures.
    assert len(labels) == 53
    assert len({figure.label for figure in FIGURES["critflow"] if figure.label}) == 8


def test_equations_and_figures_have_the_numbers_of_the_paper():
    """Counted in the source: 48 equations of the text, then the supplement; 8 figures."""
    numbers = [int(equation.number) for equation in EQUATIONS]
    assert len(set(numbers)) == len(numbers) and max(numbers) <= 92
    labels = {figure.label for figure in FIGURES["critflow"] if figure.label}
    assert {printed(label) for label in labels} == {f"Fig. {n}" for n in range(1, 9)}
    known = {"Maxwell-Calladine": 7, "FDM1": 15, "BulkModulus": 38, "ModulusStrainScaling": 48, "2FF2": 66}
    for label, number in known.items():
        assert printed(label) == f"Eq. ({number})"
    assert printed("ResponseMetrics-A-random_stress") == "Fig. 7 A, random_stress"
    assert printed("weak-modulus-exponent") == "weak-modulus-exponent"


def test_every_figure_of_the_paper_has_a_picture_and_a_caption():
    text = PAGE.read_text(encoding="utf-8")
    for figure in FIGURES["critflow"]:
        assert figure.seen and figure.pictures, figure.meaning
        if figure.label:
            assert re.search(
                rf"\.(png|gif)\)\n\n\*{re.escape(printed(figure.label))}: {re.escape(figure.meaning)}", text
            )


@pytest.mark.parametrize("function", sorted({equation.function for equation in OF_THE_SCENE}))
def test_every_function_exists(function):
    words = function.split(".")
    module, names = (words[:3], words[3:]) if words[0] == "workflows" else (["critflow", words[0]], words[1:])
    thing = importlib.import_module(".".join(module))
    for name in names:
        thing = getattr(thing, name)
    assert thing.__doc__, f"{function} has no docstring"


def test_every_equation_is_named_where_it_is_computed():
    """Its label stands in a docstring, or in the supplement's case that of the equation it derives."""
    files = [*(ROOT / "critflow").rglob("*.py"), *(ROOT / "workflows").rglob("*.py")]
    text = "".join(path.read_text(encoding="utf-8") for path in files)
    named = {equation.function for equation in OF_THE_SCENE if f"`{equation.label}`" in text}
    unnamed = [e.label for e in OF_THE_SCENE if f"`{e.label}`" not in text]
    assert set(unnamed) <= {"BondVectorFDM", "BondVectorDerivativeFDM", "BondVectorDerivativeFDM2", "tangents", "2FF2"}
    assert {equation.function for equation in OF_THE_SCENE if equation.label in unnamed} <= named


@pytest.mark.parametrize("test", sorted({e.test for e in OF_THE_SCENE if not e.test.startswith("extras/")}))
def test_every_test_exists(test):
    file, name = test.split(".")
    tree = ast.parse((ROOT / "tests" / f"{file}.py").read_text(encoding="utf-8"))
    assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_verdict_is_known():
    for equation in EQUATIONS:
        assert equation.verdict.split(":")[0].split(";")[0] in ("holds", "differs"), equation.label


def test_every_listed_study_has_its_results():
    """A study that is not listed needs no committed results."""
    runs = json.loads((CRITFLOW.reference / "runs.json").read_text(encoding="utf-8"))
    assert set(runs) <= set(studies(CRITFLOW))
    for figure in FIGURES["critflow"]:
        assert runs.get(figure.study, {}).get("seconds", 1) > 0
        for picture in figure.pictures:
            files = [CRITFLOW.reference / figure.study / "figures" / f"{picture}.{kind}" for kind in ("png", "gif")]
            assert any(file.is_file() for file in files), picture


def test_the_page_is_up_to_date():
    text = PAGE.read_text(encoding="utf-8")
    assert text == rendered(CRITFLOW), "write it again: python -m workflows.pages.results"
    for picture in re.findall(r"\]\(([^)\s]*\.(?:png|gif))\)", text):
        assert (PAGE.parent / picture).is_file(), picture


def git(*words, code=0):
    """Lines that a git command prints; the test is skipped in a copy that is no checkout."""
    if not (ROOT / ".git").exists():
        pytest.skip("what git tracks and ignores: this copy of the sources is no checkout")
    done = subprocess.run(["git", *words], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == code, done.stderr
    return done.stdout.split()


def test_a_run_changes_no_tracked_file():
    """Everything that a run writes to results/NAME is ignored, and only that."""
    for study in ("ensemble", "reference_free", "reference2"):
        for file in ("study.json", "figures/gallery.png", "claims.json", "summary.json", f"{study}.nc", "shards/0.nc"):
            assert git("check-ignore", f"results/{study}/{file}")
    tracked = git("ls-files", "results")
    assert tracked
    assert all(name == "results/README.md" or name.startswith("results/reference/") for name in tracked)
    git("check-ignore", "results/README.md", "results/reference/ensemble/claims.md", code=1)


def test_no_tracked_file_is_large():
    assert all((ROOT / name).stat().st_size <= 2**20 for name in git("ls-files") if (ROOT / name).is_file())


@pytest.mark.parametrize("name", sorted(named_studies()))
def test_every_study_loads_under_its_name(name):
    assert load_study(name).study.name == name
