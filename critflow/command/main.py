"""The `critflow` command: its subcommands, and the exit code of each error.

Modules that compute, and those that need xarray, dask or matplotlib, are imported inside the functions of the
subcommands: they take most of the start-up time, a mistake in the arguments needs none of them, and worker processes
import this module again.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
import traceback
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import click

from critflow.engine.code_digest import code_version, load_study, named_studies, timestamp
from critflow.engine.settings import HOUR, Workers, select, spelled
from critflow.engine.store import (
    CHANGED,
    DAMAGED,
    DONE,
    FAILED,
    MISSING,
    OTHER,
    Folder,
    Interrupted,
    LockedError,
    dataset_files,
    reason_lines,
)
from critflow.engine.study import plural
from critflow.extensions import joined, loaded, more
from critflow.result import CritflowError, EnvironmentFailure, InputError, IntegrityError

INTERRUPTED, INTEGRITY, FAILED_CASES = 130, 4, 3  # exit codes
EXIT_CODES = (
    (Interrupted, INTERRUPTED),
    (InputError, 2),
    (IntegrityError, INTEGRITY),
    (LockedError, 5),
    (EnvironmentFailure, 6),
)
_MOST_FAILURES = 10  # lines
_SMALL = ("n_vertices=100", "seeds=0:20", "strains=0.002,0.005,0.01")  # settings of the ensemble of the notebooks


def main(words: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code; every error is one line on stderr."""
    try:
        return app(sys.argv[1:] if words is None else list(words), prog_name="critflow", standalone_mode=False) or 0
    except click.Abort:
        return fail("interrupted: run the same command again", INTERRUPTED)
    except click.ClickException as error:
        message = error.format_message().replace(". Did you mean", ", did you mean").rstrip(".?")
        if isinstance(error, click.exceptions.NoSuchCommand) and "did you mean" not in message:
            message += more("commands, such as examine and convert")
        forgotten = "extra argument" in message and "=" in message
        path = getattr(getattr(error, "ctx", None), "command_path", "critflow")
        return fail(f"{message}: {'write --set before KEY=VALUE' if forgotten else f'see {path} --help'}", 2)
    except CritflowError as error:
        return fail(str(error), next((code for kind, code in EXIT_CODES if isinstance(error, kind)), 1))
    except MemoryError:
        return fail("out of memory: give a --memory-limit, fewer --workers or smaller settings", 6)
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        return fail(f"the operating system refused{where}: {error.strerror or repr(error)}: correct this, run again", 6)
    except (ImportError, SyntaxError) as error:
        return fail(f"a module cannot be imported: {error}: install critflow, or what joined it, again", 6)
    except Exception as error:
        return fail(f"unexpected {type(error).__name__}: {error}: set CRITFLOW_TRACEBACK=1 for the traceback", 1)


def fail(sentence: str, code: int) -> int:
    if os.environ.get("CRITFLOW_TRACEBACK"):
        traceback.print_exc()
    warn(sentence)
    return code


def warn(sentence: str) -> None:
    print("critflow:", " ".join(sentence.split()), file=sys.stderr)


class Subcommands(click.Group):
    """The subcommands of critflow, and those of the entry points `critflow.commands`, in the order of their use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The words of the help: one whose package is broken is left out with a warning."""
        words = list(self.commands)
        for name, entry in joined("commands").items():
            try:
                loaded(entry)
                words.append(name)
            except EnvironmentFailure as error:
                warn(str(error))
        return words

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        entry = joined("commands").get(name)
        return self.commands.get(name) or (loaded(entry) if entry else None)


@click.group(cls=Subcommands, no_args_is_help=False, epilog="critflow COMMAND --help prints the options of a command.")
@click.version_option(package_name="critflow", message="%(prog)s %(version)s", help="Print the version.")
def app() -> None:
    """Design spring networks at the rigidity transition, and measure ensembles of them."""


folder_argument = click.argument("folder", metavar="DIR", type=Path, help="A results folder.")
study_option = click.option(
    "--study", default="", metavar="NAME|FILE", help="The study of a folder that was moved away from its study file."
)


def refuse_batch(context: click.Context, option: click.Parameter, value: str | None) -> None:
    """Say what takes the place of the options for batch systems and parts of a run, which are gone."""
    if value is not None:
        raise InputError(
            "--cluster, --jobs and --part are gone: start workers in the batch system with dask-jobqueue and give "
            "their scheduler, --scheduler ADDRESS, see docs/command.md (Batch systems)"
        )


@app.command()
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
@click.option("--recompute", is_flag=True, help="Compute stored cases of other code again.")
@click.option("--keep", is_flag=True, help="Keep stored cases of other code and label them.")
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
    recompute: bool,
    keep: bool,
    dry_run: bool,
) -> int:
    """Compute a study, and write its dataset, figures and claims.

    Cases that are stored are not computed again. `critflow list NAME` prints the settings of a study.
    \fMany parameters: each is an option of the command.
    """
    from critflow.engine.run import plan_run, run_study

    if out is not None and not (out.strip() and out.isprintable()):
        raise InputError("--out must be a non-empty path")
    if recompute and keep:
        raise InputError("--recompute and --keep contradict each other: give one of them")
    timestamp()  # an invalid SOURCE_DATE_EPOCH is refused before the computation
    loaded = load_study(study)
    if scheduler and workers is not None:
        raise InputError("--workers counts local processes: leave it out with --scheduler")
    if scheduler and loaded.study.workers is not None:
        raise InputError(f"study {loaded.study.name!r} measures time and cannot run on a cluster")
    processes = loaded.study.worker_count(workers, os.cpu_count() or 1)
    place = Workers(processes, scheduler, insecure, time_limit, memory_limit)
    requested = select(loaded.study, settings)
    folder = Folder(Path(out or f"results/{loaded.study.name}"))
    folder.check_owner(loaded)
    other = "recompute" if recompute else "keep" if keep else "refuse"
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
    kept, failed, (parts, verdicts) = run_study(loaded, requested, folder, place, origin, retry_failed, other)
    stored = f"{kept} of {requested.count} requested cases were stored before"
    complete = [] if failed else ["The dataset is complete."]
    for line in (f"{folder.dataset(loaded.study.name)}: {requested.sizes}, {stored}", *parts, *complete, *verdicts):
        print(line)
    for case_id, reason in list(failed.items())[:_MOST_FAILURES]:
        print(f"  {case_id}: {reason}", file=sys.stderr)
    advice = f"see {folder.failed}: correct the cause and add --retry-failed"
    return fail(f"{plural(len(failed), 'case')} failed, {advice}", FAILED_CASES) if failed else 0


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
        warn(sentence)
    print("critflow list NAME prints the settings of a study")


@app.command()
@folder_argument
@study_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON, with every case that is not done.")
def status(folder: Path, study: str, as_json: bool) -> None:
    """Count the cases of a folder that are done, failed and missing."""
    results = Folder(folder, study)
    note, (_, selection) = results.read_note(), results.selection()
    states, code = results.states(selection), code_version(selection.study)
    found, always = Counter(one.state for one in states), (DONE, FAILED, MISSING)
    counts = {name: found[name] for name in (*always, OTHER, CHANGED, DAMAGED) if name in always or found[name]}
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


@app.command()
@folder_argument
@study_option
@click.option(
    "--sample",
    type=click.IntRange(min=0),
    default=3,
    show_default=True,
    metavar="N",
    help="Cases that are computed again.",
)
def verify(folder: Path, study: str, sample: int) -> int:
    """Read every byte of a folder, and recompute its physics.

    The physics of the stored arrays, and a sample of the cases."""
    from critflow.engine.verify import OTHER_CODE, verify_folder

    results = Folder(folder, study)
    problems, stored, physics, computed = verify_folder(results, sample)
    for problem in problems:
        warn(problem)
    if problems:
        count = plural(len(problems), "problem")
        again = " with --recompute" * any(f" {OTHER_CODE}: " in problem for problem in problems)
        return fail(f"{count} in {results.path}: run the study again{again} to correct them", INTEGRITY)
    end = ", and the physics in it was recomputed" if physics else "; the study recomputes no physics in it"
    print(f"{results.path}: {stored} stored cases agree with the dataset to the last byte{end}")
    which = "; ".join(", ".join(f"{k} {v}" for k, v in case.values.items()) for case in computed)
    print(f"{results.path}: {plural(len(computed), 'case')} computed again with the same result: {which or '-'}")
    return 0


@app.command()
@folder_argument
@study_option
@click.option("--format", default="png", show_default=True, metavar="png|pdf|svg", help="Format of the figures.")
def figures(folder: Path, study: str, format: str) -> None:
    """Draw the figures and write the claims of a folder again.

    From its dataset, or from what a stopped run stored."""
    from critflow.engine.report import write_report
    from critflow.engine.run import write_partial_dataset

    results = Folder(folder, study)
    _, selection = results.selection()
    if not dataset_files(results.dataset(selection.study.name)):
        warn(write_partial_dataset(results, {"history": "critflow figures"}))
    parts, verdicts = write_report(selection.study, results, format)
    for line in (*parts, *verdicts):
        print(line)


@app.command()
@click.argument("file", metavar="FILE", type=Path, help="A dataset that a study wrote.")
@click.option("--set", "settings", multiple=True, metavar="AXIS=VALUE", help="Choose a case; may be repeated.")
@click.option("--out", metavar="PNG", type=Path, help="Figure to write; by default named after the case, next to FILE.")
def show(file: Path, settings: Sequence[str], out: Path | None) -> None:
    """Print what a dataset is, or draw one configuration of it.

    The configuration that --set chooses, with its status and moduli."""
    from critflow.engine.dataset import opened_dataset

    if file.is_dir():
        raise InputError(f"{file} is a folder: give its dataset, {min(file.glob('*.nc'), default=file / 'NAME.nc')}")
    if file.is_file() and ".nc" not in file.suffixes:
        raise InputError(f"{file} is no dataset: give a file NAME.nc of critflow run; read_network reads tables")
    with opened_dataset(file) as dataset:
        if settings or out:
            from critflow.command.cases import draw_case

            print(draw_case(dataset, settings, out, file.parent))
        else:
            print(dataset.attrs["summary"])


def ensemble_path() -> Path:
    """The dataset of an ensemble: the file in the environment variable CRITFLOW_ENSEMBLE, or one of these.

    results/ensemble/ensemble.nc here or in a folder above, else small_ensemble/ensemble.nc here, of twenty networks
    of 100 vertices, which is computed in about 20 seconds where it does not exist.
    """
    if path := os.environ.get("CRITFLOW_ENSEMBLE"):
        return Path(path)
    small = Path("small_ensemble") / "ensemble.nc"
    files = [folder / "results" / "ensemble" / "ensemble.nc" for folder in (Path.cwd(), *Path.cwd().parents)]
    if not any(file.is_file() for file in (*files, small)):
        settings = [word for setting in _SMALL for word in ("--set", setting)]
        main(["run", "ensemble", *settings, "--workers", "0", "--out", str(small.parent)])
    return next((file for file in files if file.is_file()), small)
