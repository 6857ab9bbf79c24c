"""The order of the modules: who may import what, read from the source without running it."""

import ast
from pathlib import Path

import pytest

import critflow

ROOT = Path(critflow.__file__).parent
SOURCES = {
    ".".join(["critflow", *path.relative_to(ROOT).with_suffix("").parts]): path for path in sorted(ROOT.rglob("*.py"))
}
LAYERS = ("networks", "linalg", "precision", "solvers", "critical", "rigidity", "mechanics", "design")
PHYSICS = {name for name in SOURCES if name.split(".")[1] in LAYERS} | {"critflow.result"}
HEAVY = {"xarray", "dask", "distributed", "netCDF4", "typer", "rich"}
ALLOWED = {
    "__future__",
    "abc",
    "collections",
    "copy",
    "dataclasses",
    "enum",
    "functools",
    "itertools",
    "typing",
    "weakref",
}
# What the modules that talk to solvers may import besides; MKL is a library of C, found on the disk.
SOLVERS = {
    "critflow.linalg.backends": {"pymetis", "qdldl"},
    "critflow.solvers.cone": {"clarabel"},
    "critflow.linalg.pardiso": {"ctypes", "os", "pathlib", "sys", "sysconfig"},
    "critflow.solvers.semidefinite": {"clarabel"},
}


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


TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in SOURCES.items()}
IMPORTS = {name: imported(tree) for name, tree in TREES.items()}


def test_the_physics_is_there():
    assert {
        "critflow.networks.network",
        "critflow.critical.manifold",
        "critflow.mechanics.moduli",
        "critflow.rigidity.structure",
    } <= PHYSICS


@pytest.mark.parametrize("name", sorted(PHYSICS))
def test_physics_imports_numbers_only(name):
    outside = {module.split(".")[0] for module in IMPORTS[name]} - ALLOWED
    assert outside <= {"critflow", "numpy", "scipy", *SOLVERS.get(name, ())}
    assert {module for module in IMPORTS[name] if module.startswith("critflow")} <= PHYSICS


def test_solvers_are_behind_their_doors():
    for solver in set().union(*SOLVERS.values()):
        doors = [name for name, allowed in SOLVERS.items() if solver in allowed]
        assert [name for name in SOURCES if solver in IMPORTS[name] and name in PHYSICS] == doors, solver


def test_drawing_and_storing_stay_where_they_belong():
    for name, modules in IMPORTS.items():
        roots = {module.split(".")[0] for module in modules}
        if name.startswith("critflow.workflow") or name == "critflow.cli":
            continue
        assert not roots & HEAVY, name
        if name != "critflow.plot":
            assert "matplotlib" not in roots, name


def test_imports_run_in_one_direction():
    edges = {name: {m for m in modules if m in SOURCES and m != name} for name, modules in IMPORTS.items()}
    remaining = dict(edges)
    while remaining:
        leaves = {name for name, modules in remaining.items() if not modules & remaining.keys()}
        assert leaves, f"these modules import each other in a circle: {sorted(remaining)}"
        for name in leaves:
            del remaining[name]


@pytest.mark.parametrize("name", sorted(SOURCES))
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
            unsafe = {"eval", "__import__"} | ({"exec"} if name != "critflow.workflow.load" else set())
            assert node.func.id not in unsafe, f"{name}: {node.lineno}"
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute) and node.value.attr == "random":
            # Generators are made and passed on; the global one is never touched.
            assert node.attr in {"Generator", "default_rng", "SeedSequence", "PCG64"}, f"{name}: {node.lineno}"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            assert node.func.attr not in {"filterwarnings", "simplefilter", "seterr"}, f"{name}: {node.lineno}"


def test_every_public_name_is_there():
    assert all(hasattr(critflow, name) for name in critflow.__all__)
    with pytest.raises(AttributeError, match="'critflow' has no attribute 'nonsense'"):
        critflow.nonsense  # noqa: B018
