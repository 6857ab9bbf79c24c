"""The code that computes a case: the file of its study, the digest that is part of its identity, and its libraries.

The digest covers

    scene   every module of critflow that can decide numbers, and those of critflow-extras that the study uses:
            what its definitions import, and what `Study.extras` and its settings name, with all imports of these;
            of the engine, how a case is called and its numbers are cast
    study   the case function and the definitions that it reaches, in its files, this engine and `critflow.studies`

Comments, docstrings, the texts of refusals and of progress, and layout invalidate no stored case, nor do figures,
claims and other definitions that the case function does not reach, even in the same file.  Libraries, to which the
solvers of critflow-extras belong, are stored with each case and told apart.  No name of a machine, user or folder is
stored anywhere.
"""

from __future__ import annotations

import ast
import errno
import importlib
import importlib.util
import itertools
import os
import platform
import re
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256
from importlib.metadata import distributions, version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from critflow.engine.study import Study, nearest
from critflow.extensions import EXTRAS, has_extras, more, quantity_entry
from critflow.result import EnvironmentFailure, InputError, StudyError

_PACKAGE = Path(__file__).parents[1]
_STUDY_MODULE = "critflow_study_"  # prefix of the modules of loaded study files
_BENCHMARKS = ("failure_map", "speed")  # which are not part of the installed package
_NOT_NUMERIC = ("command", "pictures.py", "engine", "studies", "__init__.py", "__main__.py")
_STUDIES = f"{__package__.partition('.')[0]}.studies"
_ALL = "*"  # all that a module defines
_LENGTH = 12  # digits of a digest
_CASTS = {"computed", "arrays", "cast", "THREADS"}  # of `study.py`: what is between a case function and its shard
_SOLVERS = ("installed_solvers", "fastest_solver", "CondensedSaddle")  # of critflow-extras
_PACKAGES = ("numpy", "scipy", "qdldl", "clarabel", "pypardiso", "pyamg")  # that numbers may depend on


# The file of a study


@dataclass(frozen=True)
class StudyFile:
    """A loaded study and its file; the digest covers all files that were imported from its folder."""

    study: Study
    path: Path
    digest: str
    by_name: bool = False


_loaded: dict[Path, tuple[ModuleType, dict[Path, str]]] = {}  # executed files, digests of all files they consist of
_loading = threading.Lock()
_numbers = itertools.count()  # every execution has a unique module name, so that caches of two versions never mix


def named_studies() -> dict[str, Path]:
    """Every study that can be run by name: in ./workflows, in the installed package, in the source checkout."""
    studies: dict[str, Path] = {}
    folders = [Path("workflows"), _PACKAGE / "studies", _PACKAGE.parent / "workflows"]
    if extras := _file(EXTRAS):
        folders += [folder / "studies" for folder in extras.parents[:2]]
    for folder in folders:
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
        hint = nearest(word, sorted(named), "studies") if named else "there is none in ./workflows"
        if word in _BENCHMARKS:
            hint = f"run it in a source checkout of critflow, where it is workflows/benchmarks/{word}"
        raise StudyError(f"there is no study {word!r}: {hint}{more('studies')}")
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
            root = f"{_STUDY_MODULE}{path.stem}_{_digest(source)[:16]}_{next(_numbers)}"
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
    parts = path.relative_to(top).with_suffix("").parts if (top / "__init__.py").exists() else ()
    name, package = ".".join([root, *parts]), ".".join([root, *parts[:-1]])
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


def _digest(content: bytes) -> str:
    return sha256(content).hexdigest()


# The digest of the code of a case


def code_version(study: Study) -> str:
    """The code that computes the cases of a study, as it is stored with each of them."""
    digest, used = _study_code(*_origin(study))
    return f"critflow {_scene_digest(used)}, study {digest}"


def used_extras(study: Study) -> frozenset[str]:
    """The modules of critflow-extras, and of other packages that joined, whose code counts for the cases of a study.

    The definitions of the study import them, or `Study.extras` names what is in them; with all that they import of
    their package.
    """
    return _study_code(*_origin(study))[1]


def module_of(name: str) -> str | None:
    """The module of a quantity of a package that joined, or of a public name of critflow-extras."""
    entry = quantity_entry(name)
    return entry.module if entry else _public().get(name)


@cache
def _public() -> Mapping[str, str]:
    """The public names of critflow-extras and their modules, as its stub lists them: nothing is imported."""
    file = _file(EXTRAS) if has_extras() else None
    lines = ast.parse(file.with_suffix(".pyi").read_bytes()).body if file else []
    imports = (one for one in lines if isinstance(one, ast.ImportFrom))
    return {alias.name: f"{EXTRAS}.{one.module}" for one in imports for alias in one.names}


def _origin(study: Study) -> tuple[str, str, tuple[str, ...]]:
    """Module and name of the case function, and the names of packages that joined which the study declares."""
    module, name = (str(getattr(study.case, attribute, "")) for attribute in ("__module__", "__qualname__"))
    return module, name, tuple(study.extras)


def numeric_modules() -> dict[str, Path]:
    """Files of the scene that can decide numbers."""
    files = [path for path in _PACKAGE.rglob("*.py") if path.relative_to(_PACKAGE).parts[0] not in _NOT_NUMERIC]
    return {path.relative_to(_PACKAGE).as_posix(): path for path in sorted(files)}


@cache
def _scene_digest(used: frozenset[str]) -> str:
    """Digest of the scene and of some modules of packages that joined."""
    files = numeric_modules() | {name: path for name in sorted(used) if (path := _file(name))}
    lines = [f"{name}\0{_file_digest(path)}\n" for name, path in files.items()]
    nodes = ast.walk(_parsed(_PACKAGE / "engine" / "study.py"))
    lines += [_text(node) for node in nodes if _CASTS & {getattr(node, "name", ""), *_targets(node)}]
    return _digest("".join(lines).encode())[:_LENGTH]


@cache
def _file_digest(path: Path) -> str:
    return _digest(_text(_parsed(path)).encode())


@cache
def _study_code(module: str, name: str, declared: tuple[str, ...]) -> tuple[str, frozenset[str]]:
    """Digest of the definitions that a function reaches, and the modules of packages that joined which count for it."""
    for one in declared:
        if module_of(one) is None:
            raise StudyError(
                f"the study declares {one!r} in extras=, which is no quantity and no public name of critflow-extras"
                f"{more('names') or ': correct it'}"
            )
    texts, used, attributes, whole = list[str](), set(map(module_of, declared)), set[str](), False
    for (where, one), parts in reached_definitions(module, name).items():
        # A study has the same digest in each folder, whose modules have another root.
        texts.append(f"{where.removeprefix(_root(module))} {one} {''.join(map(_text, parts))}\n")
        for node in (node for part in parts for node in ast.walk(part)):
            if isinstance(node, ast.Attribute):
                attributes.add(node.attr)
            for source, imported in _imports(where, node):
                whole |= not source and imported.partition(".")[0] == EXTRAS
                used |= {_public().get(imported)} if source == EXTRAS else set()
                used |= {one for one in (source, f"{source}.{imported}".lstrip(".")) if one.startswith(f"{EXTRAS}.")}
    # Of a package that is imported as a whole, every attribute may be a public name.
    used |= {_public().get(one) for one in attributes if whole}
    return _digest("".join(sorted(texts)).encode())[:_LENGTH], _with_imports(filter(None, used))


def _with_imports(modules: Iterable[str]) -> frozenset[str]:
    """Modules, the packages that contain them, and all that they import of the same package."""
    found, waiting = set[str](), set(modules)
    while waiting:
        name = waiting.pop()
        path, top = _file(name), name.split(".")[0]
        if path is None or name in found or name == EXTRAS:  # whose names are imported at their first use
            continue
        found.add(name)
        waiting.add(name.rpartition(".")[0] or name)
        for node in ast.walk(_parsed(path)):
            named = {one for pair in _imports(name, node) for one in (pair[0], ".".join(pair).lstrip("."))}
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                named.add(node.value.partition(":")[0])  # of a table of what is imported later, "package.module:name"
            waiting |= {one for one in named if one.startswith(f"{top}.")}
    return frozenset(found)


def reached_definitions(module: str, name: str) -> dict[tuple[str, str], list[ast.stmt]]:
    """The definitions that a function reaches, by module and name, in its study, this engine and `critflow.studies`."""
    ours, reached = (_root(module), str(__package__), _STUDIES), dict[tuple[str, str], list[ast.stmt]]()
    bound, waiting = dict[str, dict[str, list[ast.stmt]]](), [(module, name)]
    while waiting:
        module, name = waiting.pop()
        # The scene counts as a whole; checks and declarations of a study decide no number.
        inside = any(module == root or module.startswith(f"{root}.") for root in ours)
        if (module, name) in reached or not inside or module == f"{__package__}.study":
            continue
        known = bound[module] = bound.get(module) or _definitions(module)
        reached[module, name] = known.get(name, [])
        # The statements without a name, such as a loop, are executed before each definition is used.
        waiting += [(module, "")] if name in known else [(module, other) for other in known]
        for node in (node for statement in reached[module, name] for node in ast.walk(statement)):
            if isinstance(node, ast.Name) and node.id in known:
                waiting.append((module, node.id))
            for source, imported in _imports(module, node):
                whole = f"{source}.{imported}".lstrip(".")
                is_module = not source or (whole.startswith(ours) and _file(whole) is not None)
                waiting.append((whole, _ALL) if is_module else (source, imported))
    return reached


def _root(module: str) -> str:
    """The package of a study, of which the module is a part."""
    root = module.split(".")[0]
    return root if root.startswith(_STUDY_MODULE) else module


def _imports(module: str, node: ast.AST) -> Iterator[tuple[str, str]]:
    """Source and name of each import of a statement in a module; the source is empty for a module as a whole."""
    if isinstance(node, ast.Import):
        yield from (("", alias.name) for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        source = "." * node.level + (node.module or "")
        if node.level:
            source = importlib.util.resolve_name(source, _package(module))
        yield from ((source, alias.name) for alias in node.names)


def _package(module: str) -> str:
    """The package that relative imports of a module, loaded or not, start from."""
    known, spec = sys.modules.get(module), None if module in sys.modules else importlib.util.find_spec(module)
    return str(known.__package__ if known else spec and spec.parent)


def _definitions(module: str) -> dict[str, list[ast.stmt]]:
    """The top-level statements of a module by the names that they bind, one for each import; others have no name."""
    bound: dict[str, list[ast.stmt]] = {"": []}
    path = _file(module)
    for statement in _parsed(path).body if path else ():
        parts = [("", statement)]
        if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            parts = [(statement.name, statement)]
        elif isinstance(statement, (ast.Import, ast.ImportFrom)):
            parts = [
                (alias.asname or alias.name.split(".")[0], type(statement)(**{**vars(statement), "names": [alias]}))
                for alias in statement.names
            ]
        elif names := _targets(statement):
            parts = [(name, statement) for name in names]
        for name, part in parts:
            bound.setdefault(name, []).append(part)
    return bound


def _targets(node: ast.AST) -> list[str]:
    """The names that an assignment binds: none where it changes what other definitions see, an attribute or an item."""
    single = [node.target] if isinstance(node, ast.AnnAssign) else []
    targets = node.targets if isinstance(node, ast.Assign) else single
    nodes = [one for target in targets for one in ast.walk(target)]
    changed = any(isinstance(one, (ast.Attribute, ast.Subscript)) for one in nodes)
    return [] if changed else [one.id for one in nodes if isinstance(one, ast.Name)]


def _file(module: str) -> Path | None:
    """The source file of a module, loaded or not."""
    try:
        known = sys.modules.get(module) or importlib.util.find_spec(module)
    except (ImportError, AttributeError):
        return None
    file = getattr(known, "__file__", None) or getattr(known, "origin", None)
    return Path(file) if file and file.endswith(".py") else None


def _parsed(path: Path) -> ast.Module:
    """The syntax tree of a file without docstrings, and without the words of its errors and of its progress."""
    tree = ast.parse(path.read_bytes())
    nodes = list(ast.walk(tree))
    imports = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module == "critflow.calls"]
    progress = {name.name for node in imports for name in node.names}
    for node in nodes:
        told = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in progress
        for words in node.args[-1:] if told else [node] * isinstance(node, ast.Raise):  # type: ignore[attr-defined]
            for text in (w for w in ast.walk(words) if isinstance(w, ast.Constant) and isinstance(w.value, str)):
                text.value = ""
        if isinstance(body := getattr(node, "body", None), list):
            texts = [s for s in body if isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant)]
            node.body = [s for s in body if s not in texts or not isinstance(s.value.value, str)]  # type: ignore
    return tree


def _text(node: Any) -> str:
    """The words of a syntax tree without places, equal in every version of Python."""
    if not isinstance(node, ast.AST):
        return f" {node!r}"
    text = f"({type(node).__name__}"
    for name, value in ast.iter_fields(node):
        items = [item for item in (value if isinstance(value, list) else [value]) if item is not None]
        named = f" {name}" if items and name not in ("type_comment", "kind") else ""
        text += named + "".join(map(_text, items))
    return f"{text})"


# Libraries, and the commit and date of a file


@cache
def libraries() -> Mapping[str, str]:
    """Versions that must be equal in every process of a run, with a digest of the files that decide numbers."""
    files = numeric_modules()
    if extras := _file(EXTRAS):
        files |= {path.relative_to(extras.parents[1]).as_posix(): path for path in sorted(extras.parent.rglob("*.py"))}
    digest = _digest("".join(f"{name}\0{_digest(path.read_bytes())}" for name, path in files.items()).encode())
    return {"critflow": f"{version('critflow')} {digest[:_LENGTH]}"} | _versions()


@cache
def environment() -> str:
    """Interpreter, processor and libraries that the numbers of a case may depend on."""
    return ", ".join(f"{name} {number}" for name, number in environment_versions().items())


def _versions() -> dict[str, str]:
    """Versions of packages, and the digest of what critflow-extras has to solve linear systems."""
    installed = {name: version(name) for name in _PACKAGES if any(distributions(name=name))}
    solvers = _with_imports(module for name in _SOLVERS if (module := module_of(name)))
    texts = [_file_digest(path) for name in sorted(solvers) if (path := _file(name))]
    return installed | ({"solvers": _digest("".join(texts).encode())[:_LENGTH]} if texts else {})


def environment_versions() -> dict[str, str]:
    """Versions of the environment by name."""
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    machine = {"python": platform.python_version(), "processor": platform.machine()}
    return machine | _versions() | {"BLAS": f"{blas['name']} {blas.get('version', '')}".strip()}


@cache
def source_tree(folder: Path = _PACKAGE.parent) -> Mapping[str, str]:
    """Commit of the source checkout that contains the library, and whether its code has uncommitted changes.

    Empty for an installed wheel, or if git fails.
    """
    if not (folder / ".git").exists():
        return {}
    # Variables set by a hook would select another repository; no lock is taken and no monitor is started.
    clean = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}

    git = ["git", "--no-optional-locks", "-c", "core.fsmonitor=false", "-C", str(folder)]
    code = [name for name in ("critflow", "workflows", "pyproject.toml") if (folder / name).exists()]
    try:
        commit, changed = (
            subprocess.run([*git, *words], env=clean, capture_output=True, text=True, check=True, timeout=10).stdout
            for words in (["rev-parse", "HEAD"], ["status", "--porcelain", "--", *code])
        )
    except (OSError, subprocess.SubprocessError):
        return {}
    return {"commit": commit.strip(), "commit_dirty": "true" if changed.strip() else "false"}


def timestamp() -> str:
    """The date of `history`: now, or SOURCE_DATE_EPOCH if set, for files without any difference."""
    word = os.environ.get("SOURCE_DATE_EPOCH", str(int(time.time())))
    if not re.fullmatch(r"[0-9]{1,11}", word):
        raise InputError(f"SOURCE_DATE_EPOCH={word} must be whole seconds since 1970")
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(int(word)))
