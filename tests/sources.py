"""The source of a package: its modules, their imports and their functions, read without running it."""

import ast
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path


def modules_of(package: str) -> dict[str, Path]:
    """The files of a package by the full names of their modules."""
    root = Path(find_spec(package).origin).parent
    files = sorted(root.rglob("*.py"))
    return {".".join([package, *path.relative_to(root).with_suffix("").parts]): path for path in files}


@cache
def parsed(path: Path) -> ast.Module:
    """The tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def imported(tree: ast.AST, modules: Collection[str] = ()) -> set[str]:
    """Modules that a tree imports absolutely, by their full names; `modules` are those that `from` can import too."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(node.module or "")
            # `from critflow import cone` imports a module too.
            names |= {f"{node.module}.{a.name}" for a in node.names if f"{node.module}.{a.name}" in modules}
    return names


def circle(imports: Mapping[str, set[str]]) -> list[str]:
    """Modules that import each other in a circle, from the imports of each."""
    remaining = {name: {m for m in modules if m in imports and m != name} for name, modules in imports.items()}
    while leaves := [name for name, modules in remaining.items() if not modules & remaining.keys()]:
        for name in leaves:
            del remaining[name]
    return sorted(remaining)


def words(node: ast.AST) -> set[str]:
    """The names within an annotation."""
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def _statements(node: ast.AST) -> Iterator[ast.stmt]:
    """All statements within a node, without their expressions, which are most of a tree."""
    for part in ("body", "orelse", "finalbody", "handlers"):
        for child in getattr(node, part, ()):
            yield child
            yield from _statements(child)


def functions(root: Path) -> dict[str, ast.FunctionDef | ast.AsyncFunctionDef]:
    """The functions of a folder, by "path:name"."""
    nodes = [(path, node) for path in sorted(root.rglob("*.py")) for node in _statements(parsed(path))]
    found = [(path, node) for path, node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return {f"{path.relative_to(root.parent)}:{node.name}": node for path, node in found}


def n_parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Parameters of a function or method, without self and cls."""
    listed = function.args.posonlyargs + function.args.args
    first = bool(listed) and listed[0].arg in ("self", "cls")
    return len(listed) + len(function.args.kwonlyargs) - first


def length(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function without the example that ends its docstring."""
    _, _, example = (ast.get_docstring(function) or "").partition(">>>")
    return function.end_lineno - function.lineno + 1 - (example.count("\n") + 2 if example else 0)
