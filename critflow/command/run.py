"""`critflow run`: arguments and messages.

Modules that compute, and those that need xarray or dask, are imported inside the function: they take most of the
start-up time, and a mistake in the arguments needs none of them.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from critflow.command.messages import fail, print_report, print_verdicts, warn
from critflow.result import InputError
from critflow.workflow.folder import Folder, Part, reason_lines
from critflow.workflow.load import StudyFile, load_study
from critflow.workflow.plan import Selection, select, spelled
from critflow.workflow.provenance import timestamp
from critflow.workflow.study import Study, plural
from critflow.workflow.tasks import HOUR

if TYPE_CHECKING:
    from critflow.workflow.run import RunPlan, RunResult

FAILED_CASES = 3  # exit code
_MOST_FAILURES = 10  # lines


@click.command()
@click.argument("study", metavar="NAME|FILE", help="A study, by name or by file.")
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
    origin = {"history": f"{shlex.join(words)} (in {place.place})"}  # no folder and no address of this machine
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
        warn(message)
    print_report(folder, result.report)
    if not result.failed:
        print("The dataset is complete.")
    print_verdicts(requested.study, folder, result.report)
    if not result.failed:
        return 0
    for case_id, reason in list(result.failed.items())[:_MOST_FAILURES]:
        print(f"  {case_id}: {reason}", file=sys.stderr)
    count = plural(len(result.failed), "case")
    return fail(f"{count} failed, see {folder.failed}: correct the cause and add --retry-failed", FAILED_CASES)
