"""The `critflow` command: arguments and messages only."""

from __future__ import annotations

import importlib
import json
import math
import os
import sys
import traceback
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer

from critflow.result import CritflowError, EnvironmentFailure, InputError, IntegrityError, Status
from critflow.workflow.errors import Interrupted, LockedError
from critflow.workflow.folder import Folder
from critflow.workflow.limits import HOUR, Limits
from critflow.workflow.load import each_named_study, load_study
from critflow.workflow.plan import select
from critflow.workflow.profiles import choose_cluster
from critflow.workflow.provenance import command_line, written_at
from critflow.workflow.reasons import Reason, made_by_other_code, reasons_to_compute
from critflow.workflow.status import folder_status, status_lines, status_plain

FAILED_CASES = 3
DAMAGED = 4
INTERRUPTED = 130
_MOST_REASONS = 20  # lines of reasons, or of damage: all cases may differ
EXIT_CODES = (
    (Interrupted, INTERRUPTED),
    (InputError, 2),
    (IntegrityError, DAMAGED),
    (LockedError, 5),
    (EnvironmentFailure, 6),
)

app = typer.Typer(
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
        help="Change a setting; may be repeated. variables=NAME,NAME computes and stores these alone, "
        "variables=scalars no arrays.",
    ),
]


def main(words: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code; every error is one line on stderr."""
    try:
        code = app(sys.argv[1:] if words is None else list(words), prog_name="critflow", standalone_mode=False) or 0
        return _complain("interrupted: run the same command again", code) if code == INTERRUPTED else code
    except typer.TyperException as error:
        return _complain(f"{error.format_message().rstrip('.')}: see critflow --help", 2)
    except CritflowError as error:
        return _complain(str(error), next((code for kind, code in EXIT_CODES if isinstance(error, kind)), 1))
    except (OSError, MemoryError) as error:
        return _complain(f"the machine refused: {str(error) or 'out of memory'}", 6)
    except Exception as error:
        hint = "set CRITFLOW_TRACEBACK=1 to see where"
        return _complain(f"unexpected {type(error).__name__}: {error}: {hint}", 1)


def _complain(sentence: str, code: int) -> int:
    if os.environ.get("CRITFLOW_TRACEBACK"):
        traceback.print_exc()
    print("critflow:", " ".join(sentence.split()), file=sys.stderr)
    return code


def _part(module: str) -> Any:
    """A part that brings xarray, dask or matplotlib, imported by the command that needs it: help stays instant."""
    return importlib.import_module(module)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"critflow {version('critflow')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Say the version.")
    ] = False,
) -> None: ...


@app.command()
def run(
    study: NameArgument,
    settings: RunSetOption = [],  # noqa: B006 (typer reads the default and copies it)
    out: Annotated[str | None, typer.Option(metavar="DIR", help="Results folder; results/NAME when left out.")] = None,
    workers: Annotated[
        int | None,
        typer.Option(help="Worker processes; one per CPU, or what the study allows, when left out; 0 for none."),
    ] = None,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="Use the dask scheduler there.")] = None,
    profile: Annotated[str | None, typer.Option(metavar="NAME", help="Use the cluster of that profile.")] = None,
    profiles: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Profiles; profiles.toml here or in ~/.config/critflow when left out."),
    ] = None,
    insecure: Annotated[bool, typer.Option("--insecure", help="Allow a scheduler without encryption.")] = False,
    time_limit: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Longest time of a case, in worker processes; an hour when left out."),
    ] = None,
    memory_limit: Annotated[
        float | None,
        typer.Option(metavar="GB", help="Memory of a worker process; a share of the machine's when left out."),
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Compute cases again that failed before, once the cause is mended.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be computed, and write nothing.")] = False,
) -> int:
    """Compute what is missing of a study, then write its dataset, figures and claims."""
    if workers is not None and workers < 0:
        raise InputError(f"--workers {workers} is negative: give how many worker processes, or 0 for none")
    for option, word in (("--out", out), ("--scheduler", scheduler)):
        if word is not None and not (word.strip() and word.isprintable()):
            raise InputError(f"{option} {word!a} is not a place: give one, or leave {option} out")
    written_at()  # refused here rather than when all is computed
    loaded = load_study(study)
    processes = loaded.study.worker_count(workers, os.cpu_count() or 1)
    cluster = choose_cluster(scheduler, profile, profiles, insecure)
    if cluster is not None and workers is not None:
        raise InputError("--workers is for this machine, and a cluster has its own: leave --workers out")
    if cluster is not None and loaded.study.workers is not None:
        raise InputError(f"a cluster may compute many cases at a time, which disturbs {study!r}: leave it out")
    limits = Limits(HOUR if time_limit is None else time_limit, memory_limit)
    if processes == 0 and cluster is None and limits != Limits():
        raise InputError("limits hold in worker processes, and --workers 0 has none: give --workers 1")
    if cluster is not None and memory_limit is not None:
        raise InputError("--memory-limit is for workers on this machine: give it to those of the cluster instead")
    selection = select(loaded.study, settings)
    folder = Folder(Path(out) if out else Path("results") / loaded.study.name)
    folder.refuse_other(loaded)
    engine = _part("critflow.workflow.run")
    sizes = " × ".join(
        f"{len(values)} {axis.key}" for axis, values in zip(loaded.study.axes, selection.axes.values(), strict=True)
    )
    count = math.prod(selection.shape)
    if dry_run:
        missing = engine.missing_cases(selection, folder)
        todo = sorted(missing.todo + missing.failed) if retry_failed else missing.todo
        _print_damage(missing.damage, folder)
        again = reasons_to_compute(selection, folder.shards, todo, missing.why, missing.others)
        cases = f"{len(todo)} of {count} cases to compute"
        print(f"{loaded.study.name}: {sizes}, {cases}, into {folder.path}")
        for key, value in selection.parameters.items():
            print(f"  {key} = {','.join(map(str, value)) if isinstance(value, tuple) else value}")
        print(f"  variables = {','.join(selection.study.selected) or 'all'}")
        _print_reasons(again)
        return 0
    result = engine.run_study(
        loaded,
        selection,
        folder,
        workers=processes,
        cluster=cluster,
        limits=limits,
        retry_failed=retry_failed,
        command=command_line(study, settings, processes, str(cluster.system) if cluster else None),
    )
    print(f"{result.dataset}: {sizes}, {result.kept} of {count} cases were there before")
    _print_report(folder, result.report)
    if not result.failed:
        return 0
    for case_id, reason in list(result.failed.items())[:10]:
        print(f"  {case_id}: {reason}", file=sys.stderr)
    bad = f"{len(result.failed)} case{'s' if len(result.failed) > 1 else ''}"
    sentence = f"{bad} failed, told one by one in {folder.path / 'failed.txt'}: mend the cause and add --retry-failed"
    return _complain(sentence, FAILED_CASES)


@app.command("list")
def list_studies() -> None:
    """Name the studies that can be run."""
    for name, loaded in each_named_study():
        if isinstance(loaded, CritflowError):
            print(f"critflow: {loaded}", file=sys.stderr)
            continue
        sizes = " × ".join(f"{len(axis.values)} {axis.key}" for axis in loaded.study.axes)
        print(f"{name}: {loaded.study.title} ({sizes})")


@app.command()
def status(
    folder: FolderArgument,
    as_json: Annotated[bool, typer.Option("--json", help="Say it in JSON, every case by name.")] = False,
) -> None:
    """Say how many cases are done, failed and missing, and why which are to be computed again."""
    results = Folder(folder)
    found = folder_status(results)
    again = reasons_to_compute(found.plan, results.shards, found.todo, found.why, found.others)
    older = made_by_other_code(found.of_other_code, found.code, results.shards)
    if as_json:
        told = status_plain(found)
        told |= {"to_compute": [reason.plain() for reason in again]}
        told |= {"other_code": [reason.plain() for reason in older]}
        print(json.dumps(told, indent=1))
        return
    print("\n".join(status_lines(found)))
    _print_reasons(again)
    _print_reasons(older)
    _print_damage(found.damage, results)


@app.command()
def verify(folder: FolderArgument) -> int:
    """Look at every byte of a folder's shards and dataset, and recompute the physics from the stored arrays."""
    results = Folder(folder)
    stored, problems, recomputed = _part("critflow.workflow.verify").verify_folder(results)
    for problem in problems:
        print("critflow:", problem, file=sys.stderr)
    if problems:
        count = f"{len(problems)} thing{'s are' if len(problems) > 1 else ' is'} wrong"
        return _complain(f"{count} in {results.path}: run the study again to mend it", DAMAGED)
    physics = ", and with their physics" if recomputed else "; no physics can be recomputed from them"
    print(f"{results.path}: {stored} stored cases and the dataset agree to the last byte{physics}")
    return 0


@app.command()
def figures(
    folder: FolderArgument,
    format: Annotated[str, typer.Option(help="png, pdf or svg.")] = "png",
) -> None:
    """Draw the figures and write the claims anew from the dataset of a folder."""
    results = Folder(folder)
    _, selection = results.selection()
    _print_report(results, _part("critflow.workflow.report").write_report(selection.study, results, format))


@app.command()
def show(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A dataset that a study wrote.")],
    settings: SetOption = [],  # noqa: B006 (as above)
    out: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Picture to write; named after the case when left out.")
    ] = None,
) -> None:
    """Draw one configuration of a dataset, chosen by its labels, and say what is known of it."""
    if file.is_dir():
        raise InputError(f"{file} is a folder and no dataset: give the file NAME.nc in it")
    choose_case = _part("critflow.workflow.choose").choose_case
    with _part("critflow.workflow.report").opened_dataset(file) as dataset:
        case = choose_case(dataset, settings)
        labels = "-".join(f"{axis}-{case[axis].item()}" for axis in dataset.attrs["axes"].split())
        outcome = Status(int(case["status"]))
        if outcome in (Status.failed, Status.missing):
            raise InputError(f"{labels} has no configuration: {outcome.message}")
        print(_part("critflow.workflow.show").show_configuration(case, out or Path(f"{labels}.png")))


def _print_damage(damage: Sequence[str], folder: Folder) -> None:
    for line in damage[:_MOST_REASONS]:
        print("critflow:", line, file=sys.stderr)
    if len(damage) > _MOST_REASONS:
        more = f"and {len(damage) - _MOST_REASONS} more are damaged"
        print(f"critflow: {more}: critflow verify {folder.path} names all", file=sys.stderr)


def _print_reasons(reasons: Sequence[Reason]) -> None:
    for reason in reasons[:_MOST_REASONS]:
        print(f"  {reason.line()}")
    if len(reasons) > _MOST_REASONS:
        print(f"  and {len(reasons) - _MOST_REASONS} more reasons: critflow status --json names all")


def _print_report(folder: Folder, report: Any) -> None:
    if report.written:
        print(f"{folder.figures}: {', '.join(report.written)}")
    if report.left_out:
        print(f"{folder.path}: left out for want of variables: {', '.join(report.left_out)}")
    if report.claims:
        verdicts = [claim.verdict for claim in report.claims if claim.verdict != "measured"]
        print(f"{folder.path / 'claims.md'}: {verdicts.count('holds')} of {len(verdicts)} claims hold")
