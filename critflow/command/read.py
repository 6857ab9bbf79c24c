"""The commands that read studies and their results: `list`, `status`, `verify`, `figures` and `show`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from critflow.command.main import INTEGRITY, fail, warn
from critflow.command.run import print_report, print_verdicts
from critflow.engine.code_digest import code_version, load_study, named_studies
from critflow.engine.settings import case_title, choose_case, spelled, stored_configuration
from critflow.engine.store import CHANGED, DAMAGED, DONE, FAILED, MISSING, OTHER, Folder, reason_lines
from critflow.engine.study import plural
from critflow.result import CritflowError, InputError, Status

if TYPE_CHECKING:
    import xarray as xr

folder_argument = click.argument("folder", metavar="DIR", type=Path, help="A results folder.")


@click.command()
@click.argument("study", default="", metavar="[NAME|FILE]", help="Print the settings of this study.")
def list_studies(study: str) -> None:
    """Name the studies that can be run, or print the settings of one."""
    if study:
        known = load_study(study).study
        print(f"{known.name}: {known.title}")
        for axis in known.axes:
            print(f"  --set {axis.key}={spelled(axis.values)}: {axis.long_name}")
        for key, value in known.parameters.items():
            print(f"  --set {key}={spelled(value)}")
        print("  --set variables=all (or scalars, or names): computed and stored")
        return
    unavailable = []
    # The study of the README comes first, benchmarks come last.
    named = named_studies()
    for name in sorted(named, key=lambda name: (name != "ensemble", "benchmarks" in named[name].parts)):
        try:
            known = load_study(name).study
        except CritflowError as error:
            inner = error.__cause__ if isinstance(error.__cause__, CritflowError) else error
            if isinstance(missing := inner.__cause__, ModuleNotFoundError):
                unavailable.append(f"{name} needs {missing.name}: pip install '.[peers]' in a copy of the repository")
            else:
                unavailable.append(f"{name} is not available: {inner}")
            continue
        sizes = " × ".join(f"{len(axis.values)} {axis.key}" for axis in known.axes)
        print(f"{name}: {known.title} ({sizes})")
    for sentence in unavailable:
        warn(sentence)
    print("critflow list NAME prints the settings of a study")


@click.command()
@folder_argument
@click.option("--json", "as_json", is_flag=True, help="Print JSON, with every case that is not done.")
def status(folder: Path, as_json: bool) -> None:
    """Count the cases of a folder that are done, failed and missing."""
    results = Folder(folder)
    note, (_, selection) = results.read_note(), results.selection()
    states, code = results.states(selection), code_version(selection.study)
    counts = {name: sum(one.state == name for one in states) for name in (DONE, FAILED, MISSING)}
    counts |= {name: n for name in (OTHER, CHANGED, DAMAGED) if (n := sum(one.state == name for one in states))}
    messages = []
    if note["code"] != code:
        messages.append(f"the last run used other code: {note['code']}, now {code}: --recompute or --keep its cases")
    if note["table"] != selection.study.table_digest:
        messages.append("the table of variables has changed: the next run computes all cases again")
    if as_json:
        record = {
            "study": selection.study.name,
            "study_version": selection.study.version,
            "parameters": dict(selection.parameters),
            "variables": list(selection.study.selected),
            "axes": {name: list(values) for name, values in selection.axes.items()},
            "total": counts,
            "to_compute": [
                {"id": one.case.id, **one.case.values, "state": one.state, "reason": one.reason}
                for one in states
                if one.state != DONE
            ],
            "messages": messages,
        }
        print(json.dumps(record, indent=1))
        return
    summary = ", ".join(f"{number} {state}" for state, number in counts.items() if number)
    print(f"{selection.study.name}: {summary} of {len(states)} cases")
    for line in [*reason_lines(states), *messages]:
        print(f"  {line}")


@click.command()
@folder_argument
@click.option(
    "--sample",
    type=click.IntRange(min=0),
    default=3,
    show_default=True,
    metavar="N",
    help="Cases that are computed again.",
)
def verify(folder: Path, sample: int) -> int:
    """Read every byte of a folder, and recompute its physics.

    The physics of the stored arrays, and a sample of the cases."""
    from critflow.engine.verify import verify_folder

    results = Folder(folder)
    problems, stored, physics, computed = verify_folder(results, sample)
    for problem in problems:
        warn(problem)
    if problems:
        count = plural(len(problems), "problem")
        return fail(f"{count} in {results.path}: run the study again to correct them", INTEGRITY)
    end = ", and the physics in it was recomputed" if physics else "; the study recomputes no physics in it"
    print(f"{results.path}: {stored} stored cases agree with the dataset to the last byte{end}")
    which = "; ".join(", ".join(f"{k} {v}" for k, v in case.values.items()) for case in computed)
    print(f"{results.path}: {plural(len(computed), 'case')} computed again with the same result: {which or '-'}")
    return 0


@click.command()
@folder_argument
@click.option("--format", default="png", show_default=True, metavar="png|pdf|svg", help="Format of the figures.")
def figures(folder: Path, format: str) -> None:
    """Draw the figures and write the claims of a folder again.

    From its dataset, or from what a stopped run stored."""
    from critflow.engine.report import write_report
    from critflow.engine.run import write_partial_dataset

    results = Folder(folder)
    _, selection = results.selection()
    if not results.dataset(selection.study.name).exists():
        warn(write_partial_dataset(results, {"history": "critflow figures"}))
    report = write_report(selection.study, results, format)
    print_report(results, report)
    print_verdicts(selection.study, results, report)


@click.command()
@click.argument("file", metavar="FILE", type=Path, help="A dataset that a study wrote.")
@click.option("--set", "settings", multiple=True, metavar="AXIS=VALUE", help="Choose a case; may be repeated.")
@click.option("--out", metavar="PNG", type=Path, help="Figure to write; by default named after the case, next to FILE.")
def show(file: Path, settings: Sequence[str], out: Path | None) -> None:
    """Print what a dataset is, or draw one configuration of it.

    The configuration that --set chooses, with its certificate."""
    from critflow.engine.dataset import opened_dataset
    from critflow.pictures import require_picture

    if file.is_dir():
        raise InputError(f"{file} is a folder: give the dataset NAME.nc in it")
    if out is not None:
        require_picture(out)
    with opened_dataset(file) as dataset:
        if not settings and out is None:
            print(dataset.attrs["summary"])
            return
        case = choose_case(dataset, settings)
        print(show_configuration(case, out or file.parent / f"{case_title(case)}.png"))


def show_configuration(case: xr.Dataset, path: Path) -> str:
    """Draw one case of a dataset to `path` and return its certificate as text.

    Raises `InputError` for a dataset without the arrays of a configuration, or a case without result.
    """
    import matplotlib.pyplot as plt

    from critflow.extensions import provided
    from critflow.manifold import CriticalConfiguration
    from critflow.networks import Network

    outcome = Status(int(case["status"]))
    if outcome in (Status.failed, Status.missing):
        raise InputError(f"{case_title(case)} has no configuration: {outcome.message}")
    arrays: dict[str, Any] = stored_configuration(case)
    sigma, x = arrays["sigma"], arrays["position"]
    if sigma is None or not np.isfinite(sigma).all():
        raise InputError("this case has no stresses: choose another, or see its status")
    network = Network(arrays["edges"], arrays["offsets"], arrays["cell"])
    critical = CriticalConfiguration(network, sigma, x, network.bond_vectors(x))
    title = ", ".join(f"{axis} {case[axis].item()}" for axis in case.attrs["axes"].split())
    text = provided("certificate_text", "certificates")(critical, title, outcome)
    drawn = provided("network_figure", "pictures of networks")
    figure = drawn(network.edges, network.offsets, arrays["cell"], x, sigma, critical.lengths, title)
    figure.savefig(path, dpi=200)
    plt.close(figure)
    return f"{text}\ndrawn in {path}"
