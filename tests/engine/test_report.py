"""Figures, claims and the summary of a dataset, and the physics that `verify` recomputes."""

import json

import xarray as xr

from critflow.command.main import main
from critflow.engine.report import entries
from critflow.engine.study import Claim

FILES = ("claims.md", "claims.json", "summary.json", "figures/modulus.png", "figures/growth.gif")


def test_equal_datasets_give_equal_files(tmp_path, run):
    for name in ("one", "two"):
        assert run(tmp_path / name) == 0
    for name in FILES:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name


NEEDS = (
    "claims=claims,",
    'claims=claims, needs={"modulus": ("modulus",), "growth": ("modulus",), '
    '"claims": ("residual",), "summary": ("residual",)},',
)


def test_parts_that_need_missing_variables_are_left_out_and_their_old_files_deleted(tmp_path, run, source, output_of):
    path, out = source(*NEEDS), tmp_path / "out"
    assert run(out, study=path) == 0
    assert all((out / name).is_file() for name in FILES)
    (line,) = [line for line in output_of(out, "variables=sigma", study=path).out.splitlines() if "modulus" in line]
    assert all(part in line for part in ("growth", "claims", "summary"))
    assert not any((out / name).exists() for name in FILES)
    assert main(["verify", str(out)]) == 0
    assert run(out, "variables=residual", study=path) == 0
    assert [name for name in FILES if (out / name).exists()] == ["claims.md", "claims.json", "summary.json"]


def test_a_claim_without_a_sample_was_measured_on_the_values_of_the_first_axis(tmp_path, run):
    for seeds, sample in (("0:2", "2 networks"), ("0", "1 network")):
        assert run(tmp_path / sample, f"seeds={seeds}") == 0
        assert {claim["sample"] for claim in json.loads((tmp_path / sample / "claims.json").read_text())} == {sample}


def test_members_that_are_not_sound_enter_neither_claims_nor_summary(tmp_path, run, source):
    """Of the largest residual, here that of a case at its step limit, the summary says nothing."""
    stalled = source('"status": Status.ok,', '"status": Status.step_limit if seed == 3 else Status.ok,')
    assert run(tmp_path / "out", "populations=random", study=stalled) == 0
    with xr.open_dataset(tmp_path / "out" / "tiny.nc") as ds:
        residual = ds.residual.values.squeeze()
        assert residual.argmax() == 3 and ds.valid.values.ravel().tolist() == [1, 1, 1, 0]
    summary, claims = (json.loads((tmp_path / "out" / f"{name}.json").read_text()) for name in ("summary", "claims"))
    assert summary["largest"] == residual[:3].max()
    assert {claim["sample"] for claim in claims} == {"3 of 4 networks"}


def test_an_entry_has_its_place_its_variants_and_the_kind_of_its_difference():
    rows = [{"variant": "FIRE", "value": "0.5", "n": "9 ascents", "verdict": "differs"}]
    claim = Claim("a", "it grows", "", "0.5", "differs", "why", "c", "3 networks", "paper", "III", "number", rows)
    parts = [
        "measured: 0.5 (3 networks)",
        "criterion: c",
        "remark: the number is another: why",
        "FIRE: 0.5 (9 ascents, differs)",
    ]
    assert entries([claim]) == ["- it grows (III): **differs**", *(f"  - {part}" for part in parts)]


def test_verify_recomputes_the_physics_of_the_study(tmp_path, run, source, said):
    good = source("claims=claims,", "claims=claims, verify=lambda ds: [],")
    assert run(tmp_path / "out", "seeds=0", study=good) == 0
    assert main(["verify", str(tmp_path / "out")]) == 0
    source("claims=claims,", "claims=claims, verify=lambda ds: ['the moduli are wrong'],")
    assert "the moduli are wrong" in said(["verify", str(tmp_path / "out")], 4).err


def test_verify_computes_a_sample_again_and_says_which(tmp_path, run, source, said):
    """Here the code is the same, and what it computes is not."""
    path = source("* rng.normal(size=n_edges)", "* rng.normal(size=n_edges) + float(Path('/proc/uptime').exists())")
    path.write_text("from pathlib import Path\n" + path.read_text().replace("'/proc/uptime'", f"'{tmp_path / 'x'}'"))
    assert run(tmp_path / "out", "populations=random", study=path) == 0
    for sample, words in ((2, "2 cases computed again"), (0, "0 cases computed again")):
        assert words in said(["verify", str(tmp_path / "out"), f"--sample={sample}"]).out
    (tmp_path / "x").touch()
    err = said(["verify", str(tmp_path / "out"), "--sample=4"], 4).err
    assert all(f"seed{seed}-random" in err for seed in range(4)) and "sigma" in err and "residual" not in err
