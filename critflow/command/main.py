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
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

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

app = typer.Typer(
    cls=Subcommands,
    help="Design spring networks at the rigidity transition, and measure ensembles of them.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

NameArgument = Annotated[str, typer.Argument(metavar="NAME|FILE", help="A study, by name or by file.")]
FolderArgument = Annotated[Path, typer.Argument(metavar="DIR", help="A results folder.")]
SetOption = Annotated[list[str], typer.Option("--set", metavar="KEY=VALUE", help="Change a setting; may be repeated.")]
RunSetOption = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a setting; may be repeated. variables=NAME,NAME computes and stores only these, "
        "status and valid; variables=scalars no arrays.",
    ),
]


def main(words: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code; every error is one line on stderr."""
    try:
        code = app(sys.argv[1:] if words is None else list(words), prog_name="critflow", standalone_mode=False) or 0
        return _fail("interrupted: run the same command again", code) if code == INTERRUPTED else code
    except typer.TyperException as error:
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


def _print_version(requested: bool) -> None:
    if requested:
        print(f"critflow {version('critflow')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None: ...


@app.command()
def run(
    study: NameArgument,
    settings: RunSetOption = [],  # noqa: B006 (typer reads the default and copies it)
    out: Annotated[str | None, typer.Option(metavar="DIR", help="Results folder; results/NAME by default.")] = None,
    workers: Annotated[
        int | None,
        typer.Option(help="Worker processes, 0 for none; one per CPU, or the study's limit, by default."),
    ] = None,
    scheduler: Annotated[str, typer.Option(metavar="ADDRESS", help="Use the dask scheduler at this address.")] = "",
    cluster: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Use a batch system (slurm, pbs, ...) with its options in dask's configuration."
        ),
    ] = "",
    jobs: Annotated[int, typer.Option(help="Batch jobs of --cluster.")] = 1,
    insecure: Annotated[bool, typer.Option("--insecure", help="Allow a scheduler without encryption.")] = False,
    time_limit: Annotated[
        float, typer.Option(metavar="SECONDS", help="Time limit of a case, in worker processes.")
    ] = HOUR,
    memory_limit: Annotated[
        float | None, typer.Option(metavar="GB", help="Memory limit of a worker process; an equal share by default.")
    ] = None,
    part: Annotated[
        str, typer.Option(metavar="I/N", help="Compute one of N parts in one folder; the last writes the dataset.")
    ] = "",
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Compute failed cases again.")] = False,
    recompute: Annotated[
        bool | None,
        typer.Option("--recompute/--keep", help="Compute stored cases of other code again, or keep and label them."),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and write nothing.")] = False,
) -> int:
    """Compute the missing cases of a study, then write its dataset, figures and claims.

    `critflow list NAME` prints the settings of a study.

    Its many parameters are the options of the command."""
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
def list_studies(
    study: Annotated[str, typer.Argument(metavar="[NAME|FILE]", help="Print the settings of this study.")] = "",
) -> None:
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
def status(
    folder: FolderArgument,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, with every case that is not done.")] = False,
) -> None:
    """Count the cases of a folder that are done, failed and missing, from the names of its files."""
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
def verify(
    folder: FolderArgument,
    sample: Annotated[int, typer.Option(min=0, metavar="N", help="Cases that are computed again.")] = 3,
) -> int:
    """Read every byte of a folder, recompute the physics from the stored arrays, and a sample of the cases."""
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
def figures(
    folder: FolderArgument,
    format: Annotated[str, typer.Option(help="png, pdf or svg.")] = "png",
) -> None:
    """Draw the figures and write the claims again from the dataset of a folder, or from what a stopped run stored."""
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
def show(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A dataset that a study wrote.")],
    settings: SetOption = [],  # noqa: B006 (as above)
    out: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Figure to write; by default named after the case, next to FILE.")
    ] = None,
) -> None:
    """Print what a dataset is, or draw one configuration of it, chosen by --set, and print its certificate."""
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
