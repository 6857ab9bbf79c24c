"""Finding a study by name or by file, and loading it."""

from __future__ import annotations

import errno
import itertools
import os
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from types import ModuleType

from critflow.result import EnvironmentFailure, StudyError
from critflow.workflow.provenance import STUDY_MODULE
from critflow.workflow.study import Study, nearest

_LARGEST = 10_000_000  # bytes of a study file: more is something else
_loading = threading.Lock()


@dataclass(frozen=True)
class StudyFile:
    """A loaded study with the file it came from; the digest tells workers whether they see the same file."""

    study: Study
    path: Path
    digest: str
    files: Mapping[str, str]  # digests of the file and of those that it brought along, by their places beside it
    by_name: bool = False


def study_folders() -> tuple[Path, ...]:
    """Where names are looked for: here, then what the wheel carries, then the source checkout."""
    package = Path(__file__).parents[1]
    return Path("workflows"), package / "studies", package.parent / "workflows"


def named_studies() -> dict[str, Path]:
    """Every study that can be run by name, the first one found for each name."""
    found: dict[str, Path] = {}
    for folder in study_folders():
        for path in sorted([*folder.glob("*/study.py"), *folder.glob("benchmarks/*/study.py")]):
            found.setdefault(path.parent.name, path)
        for path in sorted(folder.glob("*.py")):
            if not path.name.startswith("_"):
                found.setdefault(path.stem, path)
    return found


def load_study(word: str) -> StudyFile:
    """The study called NAME, or the one in FILE when the word is a path."""
    if not word.isprintable():
        raise StudyError(f"{word!a} is not text: give the name of a study, or its file NAME.py")
    if not word.strip():
        raise StudyError("the study is an empty word: give the name of a study, or its file NAME.py")
    if word.endswith(".py") or os.sep in word:
        return load_file(Path(word))
    named = named_studies()
    if word not in named:
        hint = nearest(word, list(named), "studies") if named else "no study is in ./workflows"
        raise StudyError(f"there is no study {word!r}: {hint}")
    loaded = load_file(named[word])
    if loaded.study.name != word:
        raise StudyError(
            f"the study in {named[word]} calls itself {loaded.study.name!r}: name it {word!r} like its file"
        )
    return replace(loaded, by_name=True)


def load_file(path: Path) -> StudyFile:
    """The study in a file, executed once per process while it and what it brings along stay as they are.

    So caches inside it stay warm, and a worker that serves many runs never computes with a file of yesterday.
    """
    path = path.absolute()
    source = _source(path)
    with _loading:
        loaded = _loaded.get(path)
        if loaded is None or not loaded.is_current():
            root = f"{STUDY_MODULE}{path.stem}_{_digest(source)[:16]}_{next(_numbers)}"
            module = _execute(root, path, source)
            files = {Path(file) for part in _parts(root) if (file := getattr(part, "__file__", None))}
            digests = {file: _digest(file.read_bytes()) for file in files - {path}}
            loaded = _loaded[path] = _Loaded(module, {path: _digest(source), **digests})
        module = loaded.module
    study = getattr(module, "study", None)
    if not isinstance(study, Study):
        held = f"holds {type(study).__name__} {study!r:.60}" if hasattr(module, "study") else "is missing"
        raise StudyError(
            f"the study file {path} cannot be run: `study` {held}: write study = Study(...) at its top level"
        )
    words = "".join(f"{file.name} {digest}\n" for file, digest in sorted(loaded.files.items()))
    beside = {os.path.relpath(file, path.parent): digest for file, digest in loaded.files.items()}
    return StudyFile(study, path, _digest(words.encode()), beside)


def is_unchanged(path: Path, files: Mapping[str, str]) -> bool:
    """Whether a study file and those that it brought along are what they were when they were loaded."""
    try:
        return path.name in files and all(_digest(_source(path.parent / f)) == files[f] for f in files)
    except StudyError:
        return False


@dataclass(frozen=True)
class _Loaded:
    """An executed study file, and the digests of all files that it is made of."""

    module: ModuleType
    files: Mapping[Path, str]

    def is_current(self) -> bool:
        """Whether the files beside it are what they were."""
        try:
            return all(_digest(file.read_bytes()) == digest for file, digest in self.files.items())
        except OSError:
            return False


_loaded: dict[Path, _Loaded] = {}
_numbers = itertools.count()  # every execution has a name of its own, so that nothing known of one is taken for another


def _parts(name: str) -> list[ModuleType]:
    """The module of a study file and those that it imported from beside itself."""
    return [module for known, module in list(sys.modules.items()) if known == name or known.startswith(f"{name}.")]


def _digest(content: bytes) -> str:
    return sha256(content).hexdigest()


def _source(path: Path) -> bytes:
    if path.exists() and not path.is_file():  # reading a device or a pipe might never end
        raise StudyError(f"{path} is not a file: give the name of a study, or its file NAME.py")
    try:
        if path.stat().st_size > _LARGEST:
            raise StudyError(f"{path} is too large for a study file: give the name of a study, or its file NAME.py")
        return path.read_bytes()
    except OSError as error:
        hint = "critflow list names the studies that are there"
        kind = EnvironmentFailure if error.errno in (errno.EMFILE, errno.ENFILE, errno.EIO) else StudyError
        raise kind(f"cannot read the study file {path}: {error.strerror}: {hint}") from error


def _execute(root: str, path: Path, source: bytes) -> ModuleType:
    """Run the source of a study as a module of the package that its folder belongs to, or as a package of its own.

    The package gets a private name, so that two versions of a study can be loaded in one process.
    """
    top = path.parent
    while (top / "__init__.py").exists() and (top.parent / "__init__.py").exists():
        top = top.parent
    if (top / "__init__.py").exists():
        package = ModuleType(root)
        package.__path__ = [str(top)]
        sys.modules[root] = package
        name = ".".join([root, *path.relative_to(top).with_suffix("").parts])
    else:
        name = root
    module = ModuleType(name)
    module.__file__ = str(path)
    # A study may keep its figures and claims beside it: `from .report import ...` looks in its own folder.
    if name == root:
        module.__package__, module.__path__ = name, [str(path.parent)]
    else:
        module.__package__ = name.rpartition(".")[0]
    sys.modules[name] = module  # before it runs: dataclasses look their module up
    write_bytecode = sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # nothing is left beside the studies of a user
    try:
        exec(compile(source, path, "exec"), vars(module))
    except (Exception, SystemExit) as error:
        for part in _parts(root):
            del sys.modules[part.__name__]
        reason = str(error) if isinstance(error, StudyError) else f"{type(error).__name__}: {error}"
        place = f"the study file {path}{_line(error, path)}"
        raise StudyError(f"{place} cannot be loaded: {reason}: mend it there") from error
    finally:
        sys.dont_write_bytecode = write_bytecode
    return module


def _line(error: BaseException, path: Path) -> str:
    """Where in the file an error came from, as far as it says."""
    if isinstance(error, SyntaxError):  # names its place itself
        return ""
    numbers = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
    return f", line {numbers[-1]}," if numbers else ""


def each_named_study() -> Iterator[tuple[str, StudyFile | StudyError]]:
    """Every named study in turn, or the reason why it does not load."""
    for name in named_studies():
        try:
            yield name, load_study(name)
        except StudyError as error:
            yield name, error
