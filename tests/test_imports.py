"""The layers of the package: who may import what, and how long a function may be, read from the source."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from layers import LAYERS
from public import NAMES

import critflow
import critflow_extras as ce
from critflow.extensions import extras

ROOT = Path(critflow.__file__).parent
SOURCES = {
    ".".join(["critflow", *path.relative_to(ROOT).with_suffix("").parts]): path for path in sorted(ROOT.rglob("*.py"))
}
# Layers without xarray, files, figures and processes.
PHYSICS = LAYERS[: LAYERS.index("engine")]
# The engine computes cases of any kind.
WITHOUT = {"engine": {*PHYSICS, "pictures"} - {"result", "extensions", "calls"}}
# Modules of the scene that still import an extra.  This list may only become shorter.
ARROWS: set[str] = set()
# Modules that still import a later layer.
UPWARD: set[str] = set()
HEAVY = {"xarray", "dask", "distributed", "netCDF4"}
ALLOWED = {
    *("__future__", "abc", "collections", "copy", "dataclasses", "difflib", "enum"),
    *("functools", "inspect", "itertools", "math", "re", "types", "typing", "weakref"),
}
# Modules that may import a solver package, guard it from other threads or, for the C library MKL, search the disk.
SOLVERS = {
    "critflow.calls": {"contextlib", "sys", "threading", "threadpoolctl", "time"},
    "critflow.sparse": {"qdldl"},
    "critflow.extensions": {"importlib", "pathlib", "tomllib"},
    "critflow.cones": {"clarabel"},
}

LONGEST, MOST_PARAMETERS, MOST_NAMES = 60, 8, 60
# A docstring with these words and a reason justifies more parameters.
REASON = "many parameters"


def imported(tree: ast.AST) -> set[str]:
    """Modules that a tree imports, by their full names."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names.add(node.module or "")
            # `from critflow import cone` imports a module too.
            names |= {f"{node.module}.{a.name}" for a in node.names if f"{node.module}.{a.name}" in SOURCES}
    return names


ARRAYS = {"Array", "IntArray", "Mask", "NDArray", "Extended"}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in SOURCES.items()}
IMPORTS = {name: imported(tree) for name, tree in TREES.items()}


def layer(name: str) -> str:
    return name.split(".")[1]


def layers_of(modules: set[str]) -> set[str]:
    """The layers of this package among modules."""
    return {layer(module) for module in modules if module.startswith("critflow.")}


def test_every_folder_is_a_layer():
    assert {layer(name) for name in SOURCES} - {"__init__"} == set(LAYERS)


@pytest.mark.parametrize("name", sorted(set(SOURCES) - {"critflow.__init__"}))
def test_a_layer_imports_only_those_before_it(name):
    if name.removeprefix("critflow.") in UPWARD:
        return
    before = set(LAYERS[: LAYERS.index(layer(name)) + 1])
    assert layers_of(IMPORTS[name]) - {"extras"} <= before - WITHOUT.get(layer(name), set())


def extras_of(modules: set[str]) -> set[str]:
    """The extras among modules, by name."""
    return {module.split(".")[2] for module in modules if module.startswith("critflow_extras.")}


def test_the_scene_imports_no_extra():
    scene = [name for name in SOURCES if layer(name) not in ("extras", "__init__")]
    assert {name.removeprefix("critflow.") for name in scene if extras_of(IMPORTS[name])} <= ARROWS


def test_an_extra_declares_the_extras_that_it_imports():
    for name, extra in extras().items():
        modules = [module for module in SOURCES if module.startswith(f"{extra.package}.") or module == extra.package]
        assert set().union(*(extras_of(IMPORTS[module]) for module in modules)) - {name} <= set(extra.needs), name


@pytest.mark.parametrize("name", sorted(name for name in SOURCES if layer(name) in PHYSICS))
def test_physics_imports_numbers_only(name):
    outside = {module.split(".")[0] for module in IMPORTS[name]} - ALLOWED
    assert outside <= {"critflow", "numpy", "scipy", *SOLVERS.get(name, ())}


def test_solvers_are_behind_their_doors():
    for solver in set().union(*SOLVERS.values()):
        doors = [name for name, allowed in SOLVERS.items() if solver in allowed]
        assert [name for name in SOURCES if solver in IMPORTS[name] and layer(name) in PHYSICS] == doors, solver


def test_figures_and_files_have_one_layer_each():
    for name, modules in IMPORTS.items():
        roots = {module.split(".")[0] for module in modules}
        if layer(name) in ("engine", "command", "extras"):
            continue
        assert not roots & HEAVY, name
        if layer(name) != "pictures":
            assert "matplotlib" not in roots, name


def test_imports_run_in_one_direction():
    edges = {name: {m for m in modules if m in SOURCES and m != name} for name, modules in IMPORTS.items()}
    remaining = dict(edges)
    while remaining:
        leaves = {name for name, modules in remaining.items() if not modules & remaining.keys()}
        assert leaves, f"these modules import each other in a circle: {sorted(remaining)}"
        for name in leaves:
            del remaining[name]


@pytest.mark.parametrize(
    "name",
    sorted(
        name
        for name in set(SOURCES) - {"critflow.__init__"}
        if layer(name) != "command" and not name.endswith(".command")
    ),
)  # their docstrings have it
def test_no_import_hides_inside_a_function(name):
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            assert not imported(node), f"{name}: {node.lineno}"


@pytest.mark.parametrize("name", sorted(SOURCES))
def test_nothing_global_and_nothing_unsafe(name):
    modules = {module.split(".")[0] for module in IMPORTS[name]}
    assert not modules & {"pickle", "marshal", "shelve", "cloudpickle"}
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            # A study is a Python file of the user's own, which one module runs.
            unsafe = {"eval", "__import__"} | ({"exec"} if name != "critflow.engine.code_digest" else set())
            assert node.func.id not in unsafe, f"{name}: {node.lineno}"
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute) and node.value.attr == "random":
            # Generators are made and passed on; the global one is never touched.
            assert node.attr in {"Generator", "default_rng", "SeedSequence", "PCG64"}, f"{name}: {node.lineno}"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            assert node.func.attr not in {"filterwarnings", "simplefilter", "seterr"}, f"{name}: {node.lineno}"


def test_the_command_starts_without_slow_libraries():
    """What modules import at their top level, from the command on; imports in functions and for types are later."""
    reached, waiting = set(), {"critflow", "critflow.command.main"}
    while waiting:
        name = waiting.pop()
        reached.add(name)
        nodes = TREES["critflow.__init__" if name == "critflow" else name].body
        top = imported(ast.Module([node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)], []))
        reached |= top - SOURCES.keys()
        waiting |= (top & SOURCES.keys()) - reached
    roots = {module.split(".")[0] for module in reached}
    assert {"critflow.engine.store", "click"} <= reached
    assert not roots & {"scipy", "xarray", "dask", "distributed", "matplotlib", "mpmath"}


def test_no_public_name_is_a_folder_or_a_module():
    """The import of a folder sets its name in the package, in place of the function."""
    assert not {layer(name) for name in SOURCES} & set(NAMES)


def test_every_public_name_is_there():
    # An extra that lacks another one may have names of its own all the same.
    whole = {name for name in NAMES if name not in PUBLIC or not absent([PUBLIC[name]])}
    present = {name for name in NAMES if name not in PUBLIC or PUBLIC[name] in extras()}
    assert whole <= {name for name in NAMES if hasattr(critflow, name)} <= present and len(NAMES) <= MOST_NAMES
    assert set(dir(critflow)) == {*NAMES, "__version__"}
    with pytest.raises(AttributeError, match="'critflow' has no attribute 'nonsense'"):
        critflow.nonsense  # noqa: B018


def test_a_name_of_a_deleted_extra_says_which(monkeypatch):
    monkeypatch.delitem(vars(critflow), "nearest_critical", raising=False)
    monkeypatch.delitem(sys.modules, "critflow_extras.inference.nearest", raising=False)
    monkeypatch.setitem(sys.modules, "critflow_extras.inference", None)
    for relation in ("belongs to",) if absent(["inference"]) else ("needs", "belongs to"):
        with pytest.raises(AttributeError, match=f"nearest_critical {relation} the extra 'inference', which is not"):
            ce.nearest_critical  # noqa: B018
        monkeypatch.setattr("critflow.extensions.extras", dict)


def words(node: ast.AST) -> set[str]:
    """The names within an annotation."""
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def statements(node: ast.AST) -> Iterator[ast.stmt]:
    """All statements within a node, without their expressions, which are most of a tree."""
    for part in ("body", "orelse", "finalbody", "handlers"):
        for child in getattr(node, part, ()):
            yield child
            yield from statements(child)


def functions(root: Path) -> dict[str, ast.FunctionDef | ast.AsyncFunctionDef]:
    """The functions of a folder, by "path:name"."""
    found = {}
    for path in sorted(root.rglob("*.py")):
        for node in statements(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                found[f"{path.relative_to(root.parent)}:{node.name}"] = node
    return found


@pytest.fixture(scope="module")
def every_function():
    return functions(ROOT) | functions(ROOT.parent / "workflows")


def n_parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Parameters of a function or method, without self and cls."""
    listed = function.args.posonlyargs + function.args.args
    first = bool(listed) and listed[0].arg in ("self", "cls")
    return len(listed) + len(function.args.kwonlyargs) - first


def length(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function without the example that ends its docstring."""
    _, _, example = (ast.get_docstring(function) or "").partition(">>>")
    return function.end_lineno - function.lineno + 1 - (example.count("\n") + 2 if example else 0)


def test_no_function_is_long(every_function):
    long = {name: length(node) for name, node in every_function.items()}
    assert {name: lines for name, lines in long.items() if lines > LONGEST} == {}


def test_many_parameters_have_a_reason(every_function):
    many = {name for name, node in every_function.items() if n_parameters(node) > MOST_PARAMETERS}
    unexplained = {name for name in many if REASON not in (ast.get_docstring(every_function[name]) or "").lower()}
    assert unexplained == set(), f"take fewer, or say {REASON!r} and why in the docstring"


def test_studies_name_their_neighbours_relatively():
    # In the wheel they are critflow.studies, and no package is called workflows.
    for file in sorted((Path(__file__).parents[1] / "workflows").rglob("*.py")):
        assert "from workflows" not in file.read_text(encoding="utf-8"), file


@pytest.mark.parametrize("name", sorted(name for name in SOURCES if name != "critflow_extras.explore.view"))
def test_results_do_not_change_and_arrays_are_not_compared(name):
    # == of arrays has no truth value, so that a class that holds them compares by identity.
    for node in (node for node in ast.walk(TREES[name]) if isinstance(node, ast.ClassDef)):
        options = next((text for text in map(ast.unparse, node.decorator_list) if text.startswith("dataclass")), None)
        if options is None:
            continue
        kinds = {text for field in node.body if isinstance(field, ast.AnnAssign) for text in words(field.annotation)}
        assert "frozen=True" in options, node.name
        assert "eq=False" in options or not kinds & ARRAYS, node.name
