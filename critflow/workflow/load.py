"""Load a study by name or from a file."""

from __future__ import annotations

import errno
import itertools
import os
import sys
import threading
import traceback
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from types import ModuleType

from critflow.result import EnvironmentFailure, StudyError
from critflow.workflow.code import STUDY_MODULE
from critflow.workflow.study import Study, nearest

_BENCHMARKS = ("failure_map", "speed")  # not part of the installed package
# Names of studies that are a part of another one, and the name of that.
_JOINED = {
    "design_curves": "stiffening",
    "design_isogonal": "stiffening",
    "design_stiffening": "stiffening",
    "design_poisson": "reach",
    "design_reach": "reach",
    "onset": "reach",
    "design_pruning": "topology",
    "design_topology": "topology",
}
_loading = threading.Lock()


@dataclass(frozen=True)
class StudyFile:
    """A loaded study and its file; the digest covers all files that were imported from its folder."""

    study: Study
    path: Path
    digest: str
    by_name: bool = False


_loaded: dict[Path, tuple[ModuleType, dict[Path, str]]] = {}  # executed files, digests of all files they consist of
_numbers = itertools.count()  # every execution has a unique module name, so that caches of two versions never mix


def named_studies() -> dict[str, Path]:
    """Every study that can be run by name: in ./workflows, in the installed package, in the source checkout."""
    package = Path(__file__).parents[1]
    studies: dict[str, Path] = {}
    for folder in (Path("workflows"), package / "studies", package.parent / "workflows"):
        for path in sorted([*folder.glob("*/study.py"), *folder.glob("benchmarks/*/study.py")]):
            studies.setdefault(path.parent.name, path)
        for path in sorted(folder.glob("[!_]*.py")):
            studies.setdefault(path.stem, path)
    return studies


def load_study(word: str) -> StudyFile:
    """The study NAME, or the study of a file or folder if the word is a path."""
    if not word.strip() or not word.isprintable():
        raise StudyError(f"the study {word!a} is empty or unprintable: give the name of a study, or its file NAME.py")
    if word.endswith(".py"):
        return load_file(Path(word))
    named = named_studies()
    if os.sep in word or (word not in named and (Path(word) / "study.py").is_file()):
        return load_file(Path(word) / "study.py")
    if word not in named:
        if word in _BENCHMARKS:
            place = f"run it in a source checkout of critflow, where it is workflows/benchmarks/{word}"
            raise StudyError(f"the benchmark {word!r} is not part of the installed package: {place}")
        if word in _JOINED:
            raise StudyError(f"the study {word!r} is a part of {_JOINED[word]!r}: critflow run {_JOINED[word]}")
        hint = nearest(word, list(named), "studies") if named else "there is none in ./workflows"
        raise StudyError(f"there is no study {word!r}: {hint}")
    loaded = load_file(named[word])
    if loaded.study.name != word:
        raise StudyError(f"the study in {named[word]} has the name {loaded.study.name!r}: rename it to {word!r}")
    return replace(loaded, by_name=True)


def load_file(path: Path) -> StudyFile:
    """The study in a file, executed once per process as long as the file and its imports are unchanged.

    Caches in its modules stay valid, and a worker that serves many runs never computes with an outdated file.
    """
    path = path.absolute()
    hint = "give the name of a study, or its file NAME.py; critflow list shows the names"
    if path.exists() and not path.is_file():  # reading a pipe would block
        raise StudyError(f"{path} is not a file: {hint}")
    try:
        source = path.read_bytes()
    except OSError as error:
        kind = EnvironmentFailure if error.errno in (errno.EMFILE, errno.ENFILE, errno.EIO) else StudyError
        raise kind(f"cannot read the study file {path}: {error.strerror}: {hint}") from error
    with _loading:
        module, files = _loaded.get(path, (None, {}))
        if module is None or any(not f.is_file() or _digest(f.read_bytes()) != files[f] for f in files):
            root = f"{STUDY_MODULE}{path.stem}_{_digest(source)[:16]}_{next(_numbers)}"
            module = _execute(root, path, source)
            imported = {Path(file) for part in _parts(root) if (file := getattr(part, "__file__", None))}
            files = {path: _digest(source)} | {file: _digest(file.read_bytes()) for file in imported - {path}}
            _loaded[path] = module, files
    study = getattr(module, "study", None)
    if not isinstance(study, Study):
        state = f"is {study!r:.60}" if hasattr(module, "study") else "is missing"
        raise StudyError(f"{path} is not a study file: `study` {state}: write study = Study(...) at its top level")
    lines = "".join(f"{file.name} {digest}\n" for file, digest in sorted(files.items()))
    return StudyFile(study, path, _digest(lines.encode()))


def _digest(content: bytes) -> str:
    return sha256(content).hexdigest()


def _parts(root: str) -> list[ModuleType]:
    """The modules of a study: its file and its imports from the same package."""
    return [module for name, module in list(sys.modules.items()) if name == root or name.startswith(f"{root}.")]


def _execute(root: str, path: Path, source: bytes) -> ModuleType:
    """Execute a study file under a private module name, so that two versions can be loaded in one process.

    Relative imports work: the file belongs to the package of its folder, or forms a package with its folder.
    """
    top = path.parent
    while (top / "__init__.py").exists() and (top.parent / "__init__.py").exists():
        top = top.parent
    name, package = root, root
    if (top / "__init__.py").exists():
        name = ".".join([root, *path.relative_to(top).with_suffix("").parts])
        package = name.rpartition(".")[0]
    parent = sys.modules[root] = ModuleType(root)
    parent.__path__ = [str(top)]
    module = sys.modules[name] = parent if name == root else ModuleType(name)  # dataclasses look it up
    module.__file__, module.__package__ = str(path), package
    write_bytecode = sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # in the folders of a user
    try:
        exec(compile(source, path, "exec"), vars(module))
    except (Exception, SystemExit) as error:
        for part in _parts(root):
            del sys.modules[part.__name__]
        reason = str(error) if isinstance(error, StudyError) else f"{type(error).__name__}: {error}"
        numbers = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        # The message of a syntax error contains its line.
        line = f", line {numbers[-1]}," if numbers and not isinstance(error, SyntaxError) else ""
        raise StudyError(f"the study file {path}{line} cannot be loaded: {reason}") from error
    finally:
        sys.dont_write_bytecode = write_bytecode
    return module
