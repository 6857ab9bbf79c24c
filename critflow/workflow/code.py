"""The code that a case depends on, as a digest that is part of the identity of the case.

    scene   every module of critflow that can decide numbers, and those of the extras that the study uses
    study   the case function and the definitions that it reaches, in the files of the study and in this engine

Comments, docstrings and layout invalidate no stored case, nor do figures, claims and other definitions that the case
function does not reach, even in the same file.
"""

from __future__ import annotations

import ast
import importlib.util
import re
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from hashlib import sha256
from pathlib import Path

from critflow.extensions import extras, known_names, with_needs
from critflow.workflow.study import Study

STUDY_MODULE = "critflow_study_"  # prefix of the modules of loaded study files

_PACKAGE = Path(__file__).parents[1]
_NOT_NUMERIC = ("command", "figures", "workflow", "studies", "extras", "__init__.py", "__main__.py")
_WORD = re.compile(r"(\w+)(\[|$)")  # a text that may be the name of a quantity, or of variables of a design
_EXTRAS = "critflow.extras"
_ALL = "*"  # all that a module defines
_LENGTH = 12


def code_version(study: Study) -> str:
    """The code that computes the cases of a study, as it is stored with each of them."""
    digest, used = _study_code(*_origin(study))
    return f"critflow {_scene_digest(used)}, study {digest}"


def used_extras(study: Study) -> frozenset[str]:
    """The extras whose code counts for the cases of a study: those that it declares, imports or names."""
    return _study_code(*_origin(study))[1]


def numeric_extras(modules: Iterable[str]) -> set[str]:
    """The extras that decide numbers, of which there are modules."""
    names = {name.split(".")[2] for name in modules if name.startswith(f"{_EXTRAS}.")}
    return {name for name in names if extras()[name].numeric}


def numeric_modules(of_extras: Iterable[str]) -> dict[str, Path]:
    """Files of the scene and of some extras that can decide numbers, by their paths in the package."""
    files = [path for path in _PACKAGE.rglob("*.py") if path.relative_to(_PACKAGE).parts[0] not in _NOT_NUMERIC]
    for name in of_extras:
        files += (_PACKAGE / "extras" / name).rglob("*.py")
    return {path.relative_to(_PACKAGE).as_posix(): path for path in sorted(files)}


def _origin(study: Study) -> tuple[str, str, tuple[str, ...]]:
    """Module and name of the case function, and the extras that the study declares."""
    module, name = (str(getattr(study.case, attribute, "")) for attribute in ("__module__", "__qualname__"))
    return module, name, tuple(study.extras)


@cache
def _scene_digest(used: frozenset[str]) -> str:
    """Digest of the scene and of some extras."""
    whole = sha256()
    for name, path in numeric_modules(used).items():
        whole.update(f"{name}\0{_file_digest(path)}\n".encode())
    return whole.hexdigest()[:_LENGTH]


@cache
def _file_digest(path: Path) -> str:
    return sha256("".join(_words(ast.parse(path.read_bytes()))).encode()).hexdigest()


@cache
def _study_code(module: str, name: str, declared: tuple[str, ...]) -> tuple[str, frozenset[str]]:
    """Digest of the definitions that a function reaches, and the extras that these and the study name."""
    reached = _Reached(module)
    reached.follow(module, name)
    known, named = {name for name, extra in extras().items() if extra.numeric}, {*declared, *reached.extras}
    named |= {extra for extra, names in known_names().items() if any(map(reached.has, names))}
    # Backends are chosen by the size of a matrix, by no name.
    named |= {name for name, extra in extras().items() if extra.backends or extra.iterations}
    return reached.digest(), frozenset(with_needs(named) & known)


class _Reached:
    """The definitions that a function reaches at the top level of the modules of its study and of this engine.

    extras  extras that they import
    names   names that they import from critflow, and those of attributes
    words   words in their texts that may name a quantity
    """

    def __init__(self, module: str):
        root = module.split(".")[0]
        self.root = root if root.startswith(STUDY_MODULE) else module
        self.modules: dict[str, dict[str, list[ast.stmt]]] = {}  # statements of each module by the names they bind
        self.texts: dict[tuple[str, str], str] = {}
        self.extras, self.names, self.words = set[str](), set[str](), set[str]()

    def has(self, name: str) -> bool:
        """Whether a name of an extra occurs, such as "design", "onset[D]" or "variables of stress"."""
        return name in self.names if name.isidentifier() else name.split("[")[0].split()[-1] in self.words

    def digest(self) -> str:
        """Digest of all that was reached; a study has the same one in each folder."""
        lines = [f"{module.removeprefix(self.root)} {name} {text}\n" for (module, name), text in self.texts.items()]
        return sha256("".join(sorted(lines)).encode()).hexdigest()[:_LENGTH]

    def follow(self, module: str, name: str) -> None:
        """Add a definition and all that it reaches; all of a module where it does not define the name."""
        waiting = [(module, name)]
        while waiting:
            module, name = waiting.pop()
            if (module, name) in self.texts or not self._is_ours(module):
                continue
            bound = self._bound(module)
            self.texts[module, name] = ""
            # The statements without a name, such as a loop, are executed before each definition is used.
            waiting += [(module, "")] if name in bound else [(module, other) for other in bound]
            for statement in bound.get(name, ()):
                if isinstance(statement, (ast.Import, ast.ImportFrom)):
                    waiting += self._imported(module, statement, name)
                    continue
                self.texts[module, name] += "".join(_words(statement))
                for node in _nodes(statement):
                    waiting += self._needed(module, node, bound.keys())

    def _needed(self, module: str, node: ast.AST, bound: Iterable[str]) -> Iterator[tuple[str, str]]:
        """The definitions that one node of a text refers to."""
        if isinstance(node, ast.Name) and node.id in bound:
            yield module, node.id
        elif isinstance(node, ast.Attribute):
            self.names.add(node.attr)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            self.words.update(match[1] for match in [_WORD.match(node.value)] if match)
        elif isinstance(node, (ast.Import, ast.ImportFrom)):  # inside a function
            yield from self._imported(module, node)

    def _imported(self, module: str, node: ast.Import | ast.ImportFrom, name: str = "") -> Iterator[tuple[str, str]]:
        """The definitions behind one name that a statement imports, or behind all."""
        source = ""
        if isinstance(node, ast.ImportFrom):
            source = "." * node.level + (node.module or "")
            if node.level:
                source = importlib.util.resolve_name(source, str(sys.modules[module].__package__))
        for alias in node.names:
            if name and name != _bound_name(alias):
                continue
            whole = f"{source}.{alias.name}".lstrip(".")
            if whole.startswith(f"{_EXTRAS}."):
                self.extras.add(whole.split(".")[2])
            elif whole.startswith("critflow."):
                self.names.add(alias.name)
            if source and not (self._is_ours(whole) and _file(whole)):
                yield source, alias.name
            else:
                yield whole, _ALL

    def _is_ours(self, module: str) -> bool:
        """Whether definitions are followed into a module; the scene counts as a whole."""
        known = any(module == root or module.startswith(f"{root}.") for root in (self.root, __package__))
        return bool(known) and module != f"{__package__}.study"  # checks and declarations, which decide no number

    def _bound(self, module: str) -> dict[str, list[ast.stmt]]:
        """The top-level statements of a module by the names that they bind, the others under an empty name."""
        if module not in self.modules:
            bound: dict[str, list[ast.stmt]] = {"": []}
            path = _file(module)
            for statement in ast.parse(path.read_bytes()).body if path else ():
                for name in _bound_names(statement) or [""]:
                    bound.setdefault(name, []).append(statement)
            self.modules[module] = bound
        return self.modules[module]


def _bound_names(statement: ast.stmt) -> list[str]:
    """The names that a top-level statement defines."""
    if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        return [statement.name]
    if isinstance(statement, (ast.Import, ast.ImportFrom)):
        return [_bound_name(alias) for alias in statement.names]
    if isinstance(statement, (ast.Assign, ast.AnnAssign)):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        nodes = [node for target in targets for node in ast.walk(target)]
        # An assignment to an attribute or an item changes what other definitions see.
        changes = any(isinstance(node, (ast.Attribute, ast.Subscript)) for node in nodes)
        return [] if changes else [node.id for node in nodes if isinstance(node, ast.Name)]
    return []


def _bound_name(alias: ast.alias) -> str:
    return alias.asname or alias.name.split(".")[0]


def _file(module: str) -> Path | None:
    """The source file of a module, loaded or not."""
    if module in sys.modules:
        file = getattr(sys.modules[module], "__file__", None)
    else:
        try:
            spec = importlib.util.find_spec(module)
        except (ImportError, AttributeError):
            return None
        file = spec.origin if spec else None
    return Path(file) if file and file.endswith(".py") else None


def _words(node: ast.AST) -> Iterator[str]:
    """The words of a syntax tree, without docstrings and places, equal in every version of Python."""
    yield f"({type(node).__name__}"
    for name, value in ast.iter_fields(node):
        items = value if isinstance(value, list) else [value]
        items = [item for item in items if item is not None and not _is_docstring(item)]
        if items and name not in ("type_comment", "kind"):
            yield f" {name}"
        for item in items:
            if isinstance(item, ast.AST):
                yield from _words(item)
            else:
                yield f" {item!r}"
    yield ")"


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    """A node and all nodes in it, without docstrings."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not _is_docstring(child):
            yield from _nodes(child)


def _is_docstring(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
