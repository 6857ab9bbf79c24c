"""Datasets keep the conventions that they name, in the judgement of compliance-checker."""

import json
import warnings
from pathlib import Path

import pytest
from compliance_checker.runner import CheckSuite, ComplianceChecker

from critflow.cli import main

TINY = Path(__file__).with_name("tiny_study.py")


@pytest.fixture(scope="module")
def checker():
    CheckSuite.load_all_available_checkers()


def complaints(path, suite, out):
    """What compliance-checker asks for in its strict mode, as `scope: sentence`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of its own parts
        ComplianceChecker.run_checker(str(path), [suite], 0, "strict", output_filename=str(out), output_format="json")
    told = json.loads(out.read_text())[suite]
    assert told["scored_points"] > 0
    return [
        f"{result['name']}: {sentence}"
        for priority in ("high", "medium", "low")
        for result in told[f"{priority}_priorities"]
        for sentence in result["msgs"]
    ]


# What ACDD recommends and a spring network does not have: a place on Earth, a time, an instrument, a publisher; names
# of people and institutions, which the software does not know; a name in the table of standard names.  The date stands
# in `history` alone, so that nothing else differs from run to run.
NOT_OURS = (
    *("geospatial", "time_coverage", "instrument", "platform", "publisher", "creator", "contributor", "institution"),
    *("acknowledgment", "license", "naming_authority", "project", "processing_level", "program", "metadata_link"),
    *("keywords_vocabulary", "standard_name", "Attr date_", "references"),
)

SAMPLES = {
    "scalars": ("variables=scalars",),
    "arrays": (),
    "ragged networks": (),
    "failed cases": ("trouble=1-random", "how=raise"),
    "nothing but failures": ("seeds=1", "populations=random", "trouble=1-random"),
}

# Networks with less edges than others end in NaN.
RAGGED = ("rng.normal(size=n_edges)", "np.where(np.arange(n_edges) < 3 + seed, rng.normal(size=n_edges), np.nan)")


@pytest.mark.parametrize("sample", SAMPLES)
@pytest.mark.parametrize("suite", ["cf:1.11", "acdd:1.3"])
def test_datasets_keep_the_conventions(tmp_path, checker, sample, suite):
    source = TINY.read_text()
    if sample == "ragged networks":
        source = source.replace(*RAGGED)
        assert RAGGED[1] in source
    (tmp_path / "tiny.py").write_text(source)
    words = ["run", str(tmp_path / "tiny.py"), "--workers=0", "--out", str(tmp_path / "out")]
    assert main([*words, *(f"--set={word}" for word in SAMPLES[sample])]) in (0, 3)
    found = complaints(tmp_path / "out" / "tiny.nc", suite, tmp_path / "report.json")
    if suite == "cf:1.11":
        assert found == []
    else:
        assert [line for line in found if not any(word in line for word in NOT_OURS)] == []
