"""Named clusters: which scheduler or batch system computes a run, read from a TOML file of profiles.

    [hall]                          [campus]
    system = "slurm"                system = "scheduler"
    jobs = 4                        address = "tls://head:8786"
    workers = 32                    ca_file = "ca.pem"
    memory = "64GB"                 cert = "me.pem"
    walltime = "04:00:00"           key = "me.key"

`jobs` batch jobs of `workers` one-thread processes each; all other keys of a batch system are those of dask-jobqueue.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from critflow.result import InputError
from critflow.workflow.study import nearest

_TLS_FILES = ("ca_file", "cert", "key")
_JOBS: dict[str, type] = {
    "jobs": int,  # batch jobs
    "workers": int,  # processes of one thread in each job
    "wait": int,  # seconds until the first worker must be there, and that none may be there later
    "memory": str,  # of a job
    "python": str,
    "interface": str,
    "local_directory": str,
    "log_directory": str,
    "death_timeout": int,
    "job_script_prologue": list,
    "job_extra_directives": list,
}
_BATCH: dict[str, type] = {"queue": str, "account": str, "walltime": str}
_KEYS: dict[str, dict[str, type]] = {
    "scheduler": {"address": str, "wait": int, **dict.fromkeys(_TLS_FILES, str)},
    "slurm": _JOBS | _BATCH | {"job_cpu": int, "job_mem": str},
    "pbs": _JOBS | _BATCH | {"resource_spec": str},
    "htcondor": _JOBS | {"disk": str, "submit_command_extra": list, "cancel_command_extra": list},
    "local": _JOBS,  # jobs are processes here, for a trial of everything but the queue
}
_REQUIRED = {
    "scheduler": ("address",),
    "slurm": ("workers", "memory"),
    "pbs": ("workers", "memory"),
    "htcondor": ("workers", "memory", "disk"),
    "local": ("workers", "memory"),
}
_WORDS: dict[type, str] = {int: "a whole number above zero", str: "a text", list: "a list of texts"}


@dataclass(frozen=True)
class Cluster:
    """Workers elsewhere: a scheduler that runs already, or jobs of a batch system.

    `options` are the keys that dask-jobqueue has too.
    """

    system: str
    name: str = ""  # of the profile; none for an address on the command line
    address: str = ""
    wait: float = 60.0
    tls: Mapping[str, str] = field(default_factory=dict)  # ca_file, cert and key
    jobs: int = 1
    workers: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        if self.system == "scheduler":
            return self.address
        return f"{self.jobs} × {self.workers} workers of {self.system} profile {self.name!r}"


def choose_cluster(scheduler: str | None, profile: str | None, profiles: Path | None, insecure: bool) -> Cluster | None:
    """The cluster that the command line names, refused where others could read along or send it work."""
    if scheduler is not None and profile is not None:
        raise InputError("--scheduler and --profile name two clusters: give one of them")
    if profile is None and profiles is not None:
        raise InputError(f"--profiles {profiles} names no profile of it: add --profile NAME")
    if profile is not None:
        cluster = read_profile(profile, profiles)
    elif scheduler is not None:
        cluster = Cluster("scheduler", address=scheduler)
    else:
        cluster = None
    if cluster is None or cluster.system != "scheduler":
        if insecure:
            raise InputError("--insecure is about a scheduler at a plain address: leave it out")
        return cluster
    _refuse_open(cluster, insecure)
    return cluster


def _refuse_open(cluster: Cluster, insecure: bool) -> None:
    """Whoever reaches a scheduler without TLS can have it run anything."""
    scheme = cluster.address.partition("://")[0] if "://" in cluster.address else "tcp"
    if scheme not in ("tcp", "tls"):
        raise InputError(f"the scheduler address {cluster.address} must begin with tls:// or tcp://")
    if scheme == "tcp" and cluster.tls:
        raise InputError(f"profile {cluster.name!r} has certificates for a plain address: write tls:// before it")
    if scheme == "tcp" and not insecure:
        raise InputError(
            f"the scheduler at {cluster.address} has no encryption, so others on its network can read along and run "
            f"code as you: use a tls:// address, or add --insecure"
        )


def read_profile(name: str, file: Path | None = None) -> Cluster:
    """One profile of a file; all that is wrong with it is an `InputError` of one sentence."""
    path = file or _default_file()
    try:
        profiles = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read the profiles in {path}: {error.strerror}") from error
    except ValueError as error:  # of TOML or of UTF-8
        raise InputError(f"the profiles in {path} are not TOML: {error}") from error
    if name not in profiles:
        hint = nearest(name, list(profiles), "profiles") if profiles else "the file is empty"
        raise InputError(f"{path} has no profile {name!r}: {hint}")
    where = f"profile {name!r} in {path}"
    given = profiles[name]
    if not isinstance(given, dict):
        raise InputError(f"{where} is not a table: begin it with [{name}]")
    return _cluster(name, given, where, path.parent)


def _cluster(name: str, given: dict[str, Any], where: str, folder: Path) -> Cluster:
    given = dict(given)
    system = given.pop("system", None)
    if not isinstance(system, str) or system not in _KEYS:
        raise InputError(f"{where} needs a system: one of {', '.join(_KEYS)}")
    keys = _KEYS[system]
    for key, value in given.items():
        if key not in keys:
            raise InputError(f"{where} has an unknown key {key!r}: {nearest(key, list(keys), 'keys')}")
        if not _fits(value, keys[key]):
            raise InputError(f"{key} of {where} must be {_WORDS[keys[key]]}, not {value!r}")
    if missing := [key for key in _REQUIRED[system] if key not in given]:
        raise InputError(f"{where} needs the key{'s' if len(missing) > 1 else ''} {', '.join(missing)}")
    if system == "scheduler":
        return _scheduler(name, given, where, folder)
    jobs, workers = given.pop("jobs", 1), given.pop("workers")
    wait = given.pop("wait", 3600)  # a queue may be long
    return Cluster(system, name, wait=wait, jobs=jobs, workers=workers, options=given)


def _scheduler(name: str, given: dict[str, Any], where: str, folder: Path) -> Cluster:
    tls = {key: str(folder / Path(given[key]).expanduser()) for key in _TLS_FILES if key in given}
    if tls and len(tls) < len(_TLS_FILES):
        raise InputError(f"{where} needs all of {', '.join(_TLS_FILES)}, or none")
    for key, path in tls.items():
        if not os.path.isfile(path):
            raise InputError(f"{key} of {where} is {path}, which is not a file")
    return Cluster("scheduler", name, given["address"], given.get("wait", 60), tls)


def _fits(value: Any, kind: type) -> bool:
    if kind is list:
        return isinstance(value, list) and all(isinstance(item, str) for item in value)
    return isinstance(value, str) if kind is str else type(value) is int and value > 0


def _default_file() -> Path:
    """`profiles.toml` here, else in the user's own configuration."""
    settings = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    files = (Path("profiles.toml"), settings / "critflow" / "profiles.toml")
    found = next((file for file in files if file.is_file()), None)
    if found is None:
        raise InputError(f"there are no profiles in {files[0]} or {files[1]}: write one, or give --profiles FILE")
    return found
