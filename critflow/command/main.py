"""The `critflow` command: arguments and messages only.

A command imports inside its function the modules that compute, and those that need xarray, dask or matplotlib: they
take most of the start-up time, and worker processes import this module again.  Extras add further commands.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from critflow.command.subcommands import Subcommands
from critflow.result import CritflowError, EnvironmentFailure, InputError, IntegrityError
from critflow.workflow.claim import KINDS, MEANING, verdict_sentence
from critflow.workflow.code import code_version
from critflow.workflow.folder import (
    CHANGED,
    DAMAGED,
    DONE,
    FAILED,
    MISSING,
    OTHER,
    Folder,
    LockedError,
    Part,
    reason_lines,
)
from critflow.workflow.load import StudyFile, load_study, named_studies
from critflow.workflow.plan import Selection, select, spelled
from critflow.workflow.provenance import timestamp
from critflow.workflow.study import Study, plural
from critflow.workflow.tasks import HOUR, Interrupted

if TYPE_CHECKING:
    from critflow.workflow.report import Report
    from critflow.workflow.run import RunPlan, RunResult

FAILED_CASES = 3
INTEGRITY = 4
INTERRUPTED = 130
EXIT_CODES = (
    (Interrupted, INTERRUPTED),
    (InputError, 2),
    (IntegrityError, INTEGRITY),
    (LockedError, 5),
    (EnvironmentFailure, 6),
)
_MOST_FAILURES = 10  # lines

study_argument = click.argument("study", metavar="NAME|FILE", help="A study, by name or by file.")
folder_argument = click.argument("folder", metavar="DIR", type=Path, help="A results folder.")


def main(words: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code; every error is one line on stderr."""
    try:
        return app(sys.argv[1:] if words is None else list(words), prog_name="critflow", standalone_mode=False) or 0
    except click.Abort:
        return _fail("interrupted: run the same command again", INTERRUPTED)
    except click.ClickException as error:
        message = error.format_message().rstrip(".")
        forgotten = "extra argument" in message and "=" in message
        return _fail(f"{message}: {'write --set before KEY=VALUE' if forgotten else 'see critflow --help'}", 2)
    except CritflowError as error:
        return _fail(str(error), next((code for kind, code in EXIT_CODES if isinstance(error, kind)), 1))
    except (OSError, MemoryError) as error:
        return _fail(f"the operating system refused: {str(error) or 'out of memory'}", 6)
    except Exception as error:
        hint = "set CRITFLOW_TRACEBACK=1 for the traceback"
        return _fail(f"unexpected {type(error).__name__}: {error}: {hint}", 1)


def _fail(sentence: str, code: int) -> int:
    if os.environ.get("CRITFLOW_TRACEBACK"):
        traceback.print_exc()
    _warn(sentence)
    return code


def _warn(sentence: str) -> None:
    print("critflow:", " ".join(sentence.split()), file=sys.stderr)


@click.group(cls=Subcommands, no_args_is_help=False, epilog="critflow COMMAND --help prints the options of a command.")
@click.version_option(package_name="critflow", message="%(prog)s %(version)s", help="Print the version.")
def app() -> None:
    """Design spring networks at the rigidity transition, and measure ensembles of them."""


@app.command()
@study_argument
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change a setting; may be repeated. variables=NAME,NAME computes and stores only these, status and valid; "
    "variables=scalars no arrays.",
)
@click.option("--out", metavar="DIR", help="Results folder; results/NAME by default.")
@click.option(
    "--workers",
    type=int,
    metavar="N",
    help="Worker processes, 0 for none; by default one per CPU, or the study's limit.",
)
@click.option("--scheduler", default="", metavar="ADDRESS", help="Use the dask scheduler at this address.")
@click.option(
    "--cluster",
    default="",
    metavar="NAME",
    help="Use a batch system (slurm, pbs, ...) with its options in dask's configuration.",
)
@click.option("--jobs", default=1, metavar="N", show_default=True, help="Batch jobs of --cluster.")
@click.option("--insecure", is_flag=True, help="Allow a scheduler without encryption.")
@click.option(
    "--time-limit",
    default=HOUR,
    show_default=True,
    metavar="SECONDS",
    help="Time limit of a case, in worker processes.",
)
@click.option(
    "--memory-limit", type=float, metavar="GB", help="Memory limit of a worker process; an equal share by default."
)
@click.option(
    "--part", default="", metavar="I/N", help="Compute one of N parts in one folder; the last writes the dataset."
)
@click.option("--retry-failed", is_flag=True, help="Compute failed cases again.")
@click.option(
    "--recompute/--keep", default=None, help="Compute stored cases of other code again, or keep and label them."
)
@click.option("--dry-run", is_flag=True, help="Print the plan and write nothing.")
def run(
    study: str,
    settings: Sequence[str],
    out: str | None,
    workers: int | None,
    scheduler: str,
    cluster: str,
    jobs: int,
    insecure: bool,
    time_limit: float,
    memory_limit: float | None,
    part: str,
    retry_failed: bool,
    recompute: bool | None,
    dry_run: bool,
) -> int:
    """Compute a study, and write its dataset, figures and claims.

    Cases that are stored are not computed again. `critflow list NAME` prints the settings of a study.
    \f
    Many parameters: each is an option of the command.
    """
    from critflow.workflow.run import plan_run, run_study
    from critflow.workflow.workers import Workers

    _check_out(out)
    timestamp()  # an invalid SOURCE_DATE_EPOCH is refused before the computation
    loaded = load_study(study)
    if scheduler or cluster:
        _check_remote(loaded.study, workers)
    count = loaded.study.worker_count(workers, os.cpu_count() or 1)
    place = Workers(count, scheduler, cluster, jobs, insecure, time_limit, memory_limit)
    requested = select(loaded.study, settings)
    folder = Folder(Path(out or f"results/{loaded.study.name}"), Part.of(part))
    folder.check_owner(loaded)
    other = "refuse" if recompute is None else "recompute" if recompute else "keep"
    if dry_run:
        return _print_plan(loaded, requested, folder, plan_run(folder, requested, retry_failed, other))
    words = ["critflow", "run", Path(study).name, *(f"--set={word}" for word in settings)]
    origin = _origin(f"{shlex.join(words)} (in {place.place})")  # no folder and no address of this machine
    result = run_study(loaded, requested, folder, place, origin, retry_failed=retry_failed, other=other)
    return _print_result(requested, folder, result)


def _check_remote(study: Study, workers: int | None) -> None:
    if workers is not None:
        raise InputError("--workers counts local processes: leave it out with --scheduler or --cluster")
    if study.workers is not None:
        raise InputError(f"study {study.name!r} measures time and cannot run on a cluster")


def _check_out(out: str | None) -> None:
    if out is not None and not (out.strip() and out.isprintable()):
        raise InputError("--out must be a non-empty path")


def _origin(command: str) -> dict[str, str]:
    """Attributes of a dataset about the command that writes it."""
    return {"history": command}


def _print_plan(loaded: StudyFile, requested: Selection, folder: Folder, plan: RunPlan) -> int:
    count = f"{len(plan.todo)} of {requested.count} cases to compute"
    print(f"{loaded.study.name}: {requested.sizes}, {count}, into {folder.path}")
    for key, value in {**requested.parameters, "variables": requested.study.selected or "all"}.items():
        print(f"  {key} = {spelled(value)}")
    planned = {case.id for case in plan.todo}
    for line in [*plan.messages, *reason_lines([state for state in plan.states if state.case.id in planned])]:
        print(f"  {line}")
    return 0


def _print_result(requested: Selection, folder: Folder, result: RunResult) -> int:
    stored = f"{result.kept} of {requested.count} requested cases were stored before"
    print(f"{result.dataset or folder.path}: {requested.sizes}, {stored}")
    for message in result.messages:
        _warn(message)
    _print_report(folder, result.report)
    if not result.failed:
        print("The dataset is complete.")
    _print_verdicts(requested.study, folder, result.report)
    if not result.failed:
        return 0
    for case_id, reason in list(result.failed.items())[:_MOST_FAILURES]:
        print(f"  {case_id}: {reason}", file=sys.stderr)
    count = plural(len(result.failed), "case")
    return _fail(f"{count} failed, see {folder.failed}: correct the cause and add --retry-failed", FAILED_CASES)


@app.command("list")
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
        _warn(sentence)
    print("critflow list NAME prints the settings of a study")


@app.command()
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
    if note.code != code:
        messages.append(f"the last run used other code: {note.code}, now {code}: --recompute or --keep its cases")
    if note.table != selection.study.table_digest:
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


@app.command()
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
    from critflow.workflow.verify import verify_folder

    results = Folder(folder)
    found = verify_folder(results, sample)
    for problem in found.problems:
        _warn(problem)
    if found.problems:
        count = plural(len(found.problems), "problem")
        return _fail(f"{count} in {results.path}: run the study again to correct them", INTEGRITY)
    physics = ", and the physics in it was recomputed" if found.physics else "; the study recomputes no physics in it"
    print(f"{results.path}: {found.stored} stored cases agree with the dataset to the last byte{physics}")
    which = "; ".join(", ".join(f"{k} {v}" for k, v in case.values.items()) for case in found.sample)
    print(f"{results.path}: {plural(len(found.sample), 'case')} computed again with the same result: {which or '-'}")
    return 0


@app.command()
@folder_argument
@click.option("--format", default="png", show_default=True, metavar="png|pdf|svg", help="Format of the figures.")
def figures(folder: Path, format: str) -> None:
    """Draw the figures and write the claims of a folder again.

    From its dataset, or from what a stopped run stored."""
    from critflow.workflow.report import write_report
    from critflow.workflow.run import write_partial_dataset

    results = Folder(folder)
    _, selection = results.selection()
    if not results.dataset(selection.study.name).exists():
        _warn(write_partial_dataset(results, _origin("critflow figures")))
    report = write_report(selection.study, results, format)
    _print_report(results, report)
    _print_verdicts(selection.study, results, report)


@app.command()
@click.argument("file", metavar="FILE", type=Path, help="A dataset that a study wrote.")
@click.option("--set", "settings", multiple=True, metavar="AXIS=VALUE", help="Choose a case; may be repeated.")
@click.option("--out", metavar="PNG", type=Path, help="Figure to write; by default named after the case, next to FILE.")
def show(file: Path, settings: Sequence[str], out: Path | None) -> None:
    """Print what a dataset is, or draw one configuration of it.

    The configuration that --set chooses, with its certificate."""
    from critflow.command.show import show_configuration
    from critflow.figures.drawing import require_picture
    from critflow.workflow.dataset import opened_dataset
    from critflow.workflow.selected import case_title, choose_case

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


def _print_report(folder: Folder, report: Report) -> None:
    if report.written:
        print(f"{folder.path}: {', '.join(report.written)}")
    if report.left_out:
        print(f"{folder.path}: not made, because the run does not store their variables: {', '.join(report.left_out)}")


def _print_verdicts(study: Study, folder: Folder, report: Report) -> None:
    """The verdicts of a report in words, and those of the committed run of the study."""
    if not report.claims:
        return
    link = f": see {folder.path / 'claims.md'}"
    texts = [text for kind in KINDS if (text := verdict_sentence(report.claims, kind, link))]
    for text in texts or [f"Measured values, without a verdict{link}."]:
        print(text)
    if verdict_sentence(report.claims, "paper", ""):
        print(f"{MEANING} {study.committed}".rstrip())
