"""`critflow run`: arguments and messages."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from critflow.command.main import fail
from critflow.engine.code_digest import load_study, timestamp
from critflow.engine.settings import HOUR, Workers, select, spelled
from critflow.engine.store import Folder, reason_lines
from critflow.engine.study import KINDS, Study, plural
from critflow.result import InputError

if TYPE_CHECKING:
    from critflow.engine.report import Report

FAILED_CASES = 3  # exit code
_MOST_FAILURES = 10  # lines


def refuse_batch(context: click.Context, option: click.Parameter, value: str | None) -> None:
    """Say what takes the place of the options for batch systems and parts of a run, which are gone."""
    if value is not None:
        raise InputError(
            "--cluster, --jobs and --part are gone: start workers in the batch system with dask-jobqueue and give "
            "their scheduler, --scheduler ADDRESS, see docs/command.md (Batch systems)"
        )


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
@click.option("--retry-failed", is_flag=True, help="Compute failed cases again.")
@click.option(
    "--recompute/--keep", default=None, help="Compute stored cases of other code again, or keep and label them."
)
@click.option("--dry-run", is_flag=True, help="Print the plan and write nothing.")
@click.option("--cluster", "--jobs", "--part", hidden=True, expose_value=False, callback=refuse_batch)
def run(
    study: str,
    settings: Sequence[str],
    out: str | None,
    workers: int | None,
    scheduler: str,
    insecure: bool,
    time_limit: float,
    memory_limit: float | None,
    retry_failed: bool,
    recompute: bool | None,
    dry_run: bool,
) -> int:
    """Compute a study, and write its dataset, figures and claims.

    Cases that are stored are not computed again. `critflow list NAME` prints the settings of a study.
    \f
    Many parameters: each is an option of the command.
    """
    from critflow.engine.run import plan_run, run_study

    if out is not None and not (out.strip() and out.isprintable()):
        raise InputError("--out must be a non-empty path")
    timestamp()  # an invalid SOURCE_DATE_EPOCH is refused before the computation
    loaded = load_study(study)
    if scheduler and workers is not None:
        raise InputError("--workers counts local processes: leave it out with --scheduler")
    if scheduler and loaded.study.workers is not None:
        raise InputError(f"study {loaded.study.name!r} measures time and cannot run on a cluster")
    count = loaded.study.worker_count(workers, os.cpu_count() or 1)
    place = Workers(count, scheduler, insecure, time_limit, memory_limit)
    requested = select(loaded.study, settings)
    folder = Folder(Path(out or f"results/{loaded.study.name}"))
    folder.check_owner(loaded)
    other = "refuse" if recompute is None else "recompute" if recompute else "keep"
    if dry_run:
        plan = plan_run(folder, requested, retry_failed, other)
        todo = {case.id for case in plan.todo}
        print(
            f"{loaded.study.name}: {requested.sizes}, {len(todo)} of {requested.count} cases to compute, into "
            f"{folder.path}"
        )
        for key, value in {**requested.parameters, "variables": requested.study.selected or "all"}.items():
            print(f"  {key} = {spelled(value)}")
        for line in [*plan.messages, *reason_lines([state for state in plan.states if state.case.id in todo])]:
            print(f"  {line}")
        return 0
    words = ["critflow", "run", Path(study).name, *(f"--set={word}" for word in settings)]
    origin = {"history": f"{shlex.join(words)} (in {place.place})"}  # no folder and no address of this machine
    kept, failed, report = run_study(loaded, requested, folder, place, origin, retry_failed, other)
    stored = f"{kept} of {requested.count} requested cases were stored before"
    print(f"{folder.dataset(loaded.study.name)}: {requested.sizes}, {stored}")
    print_report(folder, report)
    if not failed:
        print("The dataset is complete.")
    print_verdicts(requested.study, folder, report)
    for case_id, reason in list(failed.items())[:_MOST_FAILURES]:
        print(f"  {case_id}: {reason}", file=sys.stderr)
    advice = f"see {folder.failed}: correct the cause and add --retry-failed"
    return fail(f"{plural(len(failed), 'case')} failed, {advice}", FAILED_CASES) if failed else 0


def print_report(folder: Folder, report: Report) -> None:
    if report.written:
        print(f"{folder.path}: {', '.join(report.written)}")
    if report.left_out:
        print(f"{folder.path}: not made, because the run does not store their variables: {', '.join(report.left_out)}")


def print_verdicts(study: Study, folder: Folder, report: Report) -> None:
    """The verdicts of a report in words, and those of the committed run of the study."""
    from critflow.engine.report import MEANING, verdict_sentence

    if not report.claims:
        return
    link = f": see {folder.path / 'claims.md'}"
    texts = [text for kind in KINDS if (text := verdict_sentence(report.claims, kind, link))]
    for text in texts or [f"Measured values, without a verdict{link}."]:
        print(text)
    if verdict_sentence(report.claims, "paper", ""):
        print(f"{MEANING} {study.committed}".rstrip())
