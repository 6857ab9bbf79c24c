"""Counts of what a reader meets who follows a call: `python tests/way_of_a_call.py [--names]`.

Lines and modules of a run are those of all modules of the package `critflow` that are loaded after

    critflow run ensemble --set seeds=0:1 --set n_vertices=100 --workers 0

in a new process: whole files, with comments and empty lines.  Modules of the studies are not counted.

Files, functions and classes of a call are those that its second repetition enters, in one thread, by `sys.setprofile`;
imports and what is computed once for a network belong to the first.

files      files of the package `critflow` of which a function is entered
functions  functions, methods and lambda expressions of these files, and generated methods of their dataclasses, such as
           constructors; comprehensions and generator expressions are parts of the function around them
classes    classes that define an entered method, and dataclasses of which a generated method is entered; an inherited
           method counts for the class that defines it
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import critflow
from critflow.command.main import main

PACKAGE = Path(critflow.__file__).parent
SIZE = 100  # vertices
# Python 3.12 and later compile most of these into the function around them.
PARTS = ("<listcomp>", "<dictcomp>", "<setcomp>", "<genexpr>")


def lines_of_a_run():
    """Number of lines of each file of the package that is loaded after a run of the ensemble."""
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        settings = ("--set", "seeds=0:1", "--set", f"n_vertices={SIZE}")
        code = main(["run", "ensemble", *settings, "--workers", "0", "--out", str(Path(folder) / "ensemble")])
    assert code == 0, f"the ensemble ends with code {code}"
    paths = [Path(file) for module in list(sys.modules.values()) if (file := getattr(module, "__file__", None))]
    inside = sorted(path for path in set(paths) if path.is_relative_to(PACKAGE) and path.suffix == ".py")
    return {str(path.relative_to(PACKAGE)): len(path.read_text(encoding="utf-8").splitlines()) for path in inside}


def definition(frame):
    """File, qualified name and first line of the function of a frame, or None where it is none of the package."""
    code = frame.f_code
    if code.co_name in PARTS:
        return None
    if code.co_filename.startswith(f"{PACKAGE}{os.sep}"):
        return str(Path(code.co_filename).relative_to(PACKAGE)), code.co_qualname, code.co_firstlineno
    # Methods that `dataclass` generates have no file.
    owner = type(frame.f_locals.get("self"))
    if code.co_filename == "<string>" and owner.__module__.partition(".")[0] == PACKAGE.name:
        return "", f"{owner.__qualname__}.{code.co_name}", 0
    return None


def entered(call):
    """Definitions of the functions that the second of two calls enters."""
    functions = set()

    def profile(frame, event, _argument):
        if event == "call" and (function := definition(frame)):
            functions.add(function)

    call()
    sys.setprofile(profile)
    try:
        call()
    finally:
        sys.setprofile(None)
    return sorted(functions)


def counted(functions):
    """Numbers of files, functions and classes of these definitions."""
    owners = {name.rpartition(".")[0] for _, name, _ in functions}
    # `outer.<locals>.inner` is a function in a function.
    classes = {owner for owner in owners if owner and not owner.endswith("<locals>")}
    return {"files": len({file for file, *_ in functions} - {""}), "functions": len(functions), "classes": len(classes)}


def calls():
    """The calls by name: a path of two strains from the largest bulk modulus, and the largest shear modulus."""
    network = critflow.voronoi_network(n_vertices=SIZE, seed=1)
    largest_bulk = critflow.optimize(network, "B_0")
    return {
        "strain path": lambda: critflow.strain_path(largest_bulk, [0.001, 0.002]),
        "optimize G_0": lambda: critflow.optimize(network, "G_0"),
    }


def measured():
    """All counts by name, and the definitions that the counts of the calls are of."""
    lines = lines_of_a_run()
    functions = {name: entered(call) for name, call in calls().items()}
    counts = {"run ensemble": {"lines": sum(lines.values()), "modules": len(lines)}}
    return counts | {name: counted(definitions) for name, definitions in functions.items()}, functions


if __name__ == "__main__":
    counts, functions = measured()
    if "--names" in sys.argv:
        for call, definitions in functions.items():
            print(call, *(f"    {file or '(generated)'}:{line} {name}" for file, name, line in definitions), sep="\n")
    print(json.dumps(counts))
