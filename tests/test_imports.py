"""The layers of the package: who may import what, and how long a function may be, read from the source."""

import ast
import re

import pytest
from argument_checks import NAMES
from layers import LAYERS
from sources import circle, functions, imported, length, modules_of, n_parameters, parsed, words

import critflow

SOURCES = modules_of("critflow")
ROOT = SOURCES["critflow.__init__"].parent
# Layers without xarray, files, figures and processes.
PHYSICS = LAYERS[: LAYERS.index("engine")]
# The engine computes cases of any kind.
WITHOUT = {"engine": {*PHYSICS, "pictures"} - {"result", "extensions", "calls"}}
HEAVY = {"xarray", "dask", "distributed", "netCDF4"}
ALLOWED = {
    *("__future__", "abc", "collections", "copy", "dataclasses", "difflib", "enum"),
    *("functools", "inspect", "itertools", "math", "re", "types", "typing", "weakref"),
}
# Modules that may import a solver package, guard it from other threads or find what joined.
SOLVERS = {
    "critflow.calls": {"contextlib", "sys", "threading", "threadpoolctl", "time"},
    "critflow.sparse": {"qdldl"},
    "critflow.extensions": {"importlib"},
    "critflow.quantities": {"importlib"},
    "critflow.cones": {"clarabel"},
}

LONGEST, MOST_PARAMETERS, MOST_NAMES = 60, 8, 60
# A docstring with these words and a reason justifies more parameters.
REASON = "many parameters"

ARRAYS = {"Array", "IntArray", "Mask", "NDArray", "Extended"}
TREES = {name: parsed(path) for name, path in SOURCES.items()}
IMPORTS = {name: imported(tree, SOURCES) for name, tree in TREES.items()}


def layer(name: str) -> str:
    return name.split(".")[1]


def roots(name: str) -> set[str]:
    """The packages that a module imports."""
    return {module.split(".")[0] for module in IMPORTS[name]}


def layers_of(modules: set[str]) -> set[str]:
    """The layers of this package among modules."""
    return {layer(module) for module in modules if module.startswith("critflow.")}


def test_every_folder_is_a_layer():
    assert {layer(name) for name in SOURCES} - {"__init__"} == set(LAYERS)


@pytest.mark.parametrize("name", sorted(set(SOURCES) - {"critflow.__init__"}))
def test_a_layer_imports_only_those_before_it(name):
    before = set(LAYERS[: LAYERS.index(layer(name)) + 1])
    assert all(node.level == 0 for node in ast.walk(TREES[name]) if isinstance(node, ast.ImportFrom))
    assert layers_of(IMPORTS[name]) <= before - WITHOUT.get(layer(name), set())


# The writers of the pages serve both packages.
WORKFLOWS = [path for path in sorted((ROOT.parent / "workflows").rglob("*.py")) if path.parent.name != "pages"]


@pytest.mark.parametrize("path", [*SOURCES.values(), *WORKFLOWS], ids=lambda path: str(path.relative_to(ROOT.parent)))
def test_the_scene_and_its_studies_name_no_module_of_the_extras(path):
    tree = parsed(path)
    assert not {module for module in imported(tree) if module.partition(".")[0] == "critflow_extras"}
    if path != SOURCES["critflow.extensions"]:
        strings = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and type(node.value) is str]
        assert not [text for text in strings if re.match(r"critflow_extras(\.|$)", text)]


@pytest.mark.parametrize("name", sorted(name for name in SOURCES if layer(name) in PHYSICS))
def test_physics_imports_numbers_only(name):
    outside = roots(name) - ALLOWED
    assert outside <= {"critflow", "numpy", "scipy", *SOLVERS.get(name, ())}


def test_solvers_are_behind_their_doors():
    for solver in set().union(*SOLVERS.values()):
        doors = [name for name, allowed in SOLVERS.items() if solver in allowed]
        assert [name for name in SOURCES if layer(name) in PHYSICS and solver in roots(name)] == doors, solver


def test_figures_and_files_have_one_layer_each():
    for name in IMPORTS:
        if layer(name) not in ("engine", "command"):
            assert not roots(name) & (HEAVY if layer(name) == "pictures" else {*HEAVY, "matplotlib"}), name


def test_imports_run_in_one_direction():
    assert circle(IMPORTS) == []


@pytest.mark.parametrize("name", [name for name in SOURCES if layer(name) not in ("__init__", "command")])
def test_no_import_hides_inside_a_function(name):
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            assert not imported(node), f"{name}: {node.lineno}"


@pytest.mark.parametrize("name", sorted(SOURCES))
def test_nothing_global_and_nothing_unsafe(name):
    assert not roots(name) & {"pickle", "marshal", "shelve", "cloudpickle"}
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
    assert {"critflow.engine.store", "click"} <= reached
    packages = {module.split(".")[0] for module in reached}
    assert not packages & {"scipy", "xarray", "dask", "distributed", "matplotlib", "mpmath"}


def test_no_public_name_is_a_folder_or_a_module():
    """The import of a folder sets its name in the package, in place of the function."""
    assert not {layer(name) for name in SOURCES} & set(NAMES)


def test_every_public_name_is_there():
    assert all(hasattr(critflow, name) for name in NAMES) and len(NAMES) <= MOST_NAMES
    assert set(dir(critflow)) == {*NAMES, "__version__"}
    with pytest.raises(AttributeError, match="'critflow' has no attribute 'nonsense'"):
        critflow.nonsense  # noqa: B018


@pytest.fixture(scope="module")
def every_function():
    return functions(ROOT) | functions(ROOT.parent / "workflows")


def test_no_function_is_long(every_function):
    long = {name: length(node) for name, node in every_function.items()}
    assert {name: lines for name, lines in long.items() if lines > LONGEST} == {}


def test_many_parameters_have_a_reason(every_function):
    many = {name for name, node in every_function.items() if n_parameters(node) > MOST_PARAMETERS}
    unexplained = {name for name in many if REASON not in (ast.get_docstring(every_function[name]) or "").lower()}
    assert unexplained == set(), f"take fewer, or say {REASON!r} and why in the docstring"


def test_studies_name_their_neighbours_relatively():
    # In the wheel they are critflow.studies, and no package is called workflows.
    for file in WORKFLOWS:
        assert "from workflows" not in file.read_text(encoding="utf-8"), file


@pytest.mark.parametrize("name", SOURCES)
def test_results_do_not_change_and_arrays_are_not_compared(name):
    # == of arrays has no truth value, so that a class that holds them compares by identity.
    for node in (node for node in ast.walk(TREES[name]) if isinstance(node, ast.ClassDef)):
        options = next((text for text in map(ast.unparse, node.decorator_list) if text.startswith("dataclass")), None)
        if options is None:
            continue
        kinds = {text for field in node.body if isinstance(field, ast.AnnAssign) for text in words(field.annotation)}
        assert "frozen=True" in options, node.name
        assert "eq=False" in options or not kinds & ARRAYS, node.name
