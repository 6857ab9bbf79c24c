"""The API reference: the directive `layer` documents the public names of one layer of the package.

Docstrings are plain text.  Tables of two columns become definition lists, indented lines displayed equations, and
`names` links: to a public name, or to the equation of the paper with this label.
"""

import ast
import inspect
import re
from enum import Enum
from importlib import import_module
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from equations import tex_of

import critflow

ROW = re.compile(r"([^\s.]+(?:,? [^\s.]+){0,4}) {2,}(\S.*)")  # not two sentences
THEORY = Path(__file__).parents[1] / "theory"
LABELS = {  # label: the page that explains the equation
    label: page.stem
    for page in THEORY.glob("*.md")
    for label in re.findall(r"^\| `([^`]+)` \|", page.read_text(encoding="utf-8"), flags=re.M)
}
CLASS = "   :members:\n   :member-order: bysource\n   :exclude-members: __init__, __new__\n"


def exported() -> list[str]:
    """The public names of `critflow`: those that it imports as themselves, and `draw`."""
    lines = ast.parse(inspect.getsource(critflow)).body
    names = [alias for line in lines if isinstance(line, ast.ImportFrom) for alias in line.names]
    return ["draw", *(alias.name for alias in names if alias.asname == alias.name)]


PUBLIC = exported()


def public_names(layer: str) -> list[str]:
    """The names of `critflow` that are defined in this layer, in the order of their modules and lines."""
    found = []
    for name in PUBLIC:
        thing = inspect.unwrap(getattr(critflow, name))
        module = thing.__module__.split(".")
        if module[1] == layer:
            found.append((thing.__module__, inspect.getsourcelines(thing)[1], name))
    return [name for *_, name in sorted(found)]


def results_of(names: list[str]) -> list[str]:
    """The classes that these functions return and that are not public names themselves."""
    found: dict[str, None] = {}
    for name in names:
        thing = inspect.unwrap(getattr(critflow, name))
        returned = str(getattr(thing, "__annotations__", {}).get("return", ""))
        for word in re.findall(r"[A-Z]\w+", returned):
            kind = getattr(import_module(thing.__module__), word, None)
            if inspect.isclass(kind) and kind.__module__.startswith("critflow.") and word not in PUBLIC:
                found[f"{kind.__module__}.{word}"] = None
    return list(found)


def autodoc(path: str) -> str:
    """The directive of autodoc that documents this object."""
    module, _, name = path.rpartition(".")
    thing = getattr(import_module(module), name)
    if inspect.isclass(thing):
        values = "   :undoc-members:\n" if issubclass(thing, Enum) else ""
        return f".. autoclass:: {path}\n{CLASS}{values}"
    return f".. autofunction:: {path}\n"


class Layer(Directive):
    """`layer NAME`: the public names of the layer, the classes that its functions return, and names of its modules.

    The content lists the last ones, as MODULE.NAME.
    """

    required_arguments = 1
    has_content = True

    def run(self):
        layer = self.arguments[0]
        names = public_names(layer)
        paths = [f"critflow.{name}" for name in names]
        paths += [path for path in results_of(names) if path.split(".")[1] == layer]
        paths += [f"critflow.{layer}.{name}" for name in " ".join(self.content).split()]
        text = "\n".join(["````{eval-rst}", *map(autodoc, paths), "````"])
        container = nodes.container()
        self.state.nested_parse(StringList(text.splitlines(), source=f"layer {layer}"), 0, container)
        return container.children


def restructured(lines: list[str]) -> list[str]:
    """A docstring in plain text as reStructuredText."""
    made: list[str] = []
    column = 0  # of the second column, inside a table
    for line in lines:
        row = ROW.fullmatch(line)
        indent = len(line) - len(line.lstrip())
        if column and line and indent >= column:
            made[-1] += " " + line.strip()
            continue
        column = 0
        if row and row.start(1) == 0 and not line.rstrip().endswith("::"):
            column = 1
            if made and made[-1] and not made[-1].startswith("   "):
                made.append("")
            made += [f"``{row[1]}``", f"   {escaped(row[2])}"]
            column = row.start(2) if indent == 0 else 0
        elif indent and line.strip():
            made += ["", *(f".. math:: {tex_of(part)}" for part in [line.strip().rstrip(".")]), ""]
        else:
            if made and made[-1].startswith("   ") and line:
                made.append("")
            made.append(escaped(line))
    return made


def escaped(line: str) -> str:
    """A line of prose: |x|, *, and trailing underscores are text in a docstring and markup in reStructuredText."""
    parts = re.split(r"(`[^`]*`)", line)
    for at, part in enumerate(parts):
        if at % 2 == 0:
            parts[at] = re.sub(r"([|*\\_])", r"\\\1", part)
        else:
            parts[at] = reference(part.strip("`"))
    return "".join(parts)


def reference(name: str) -> str:
    if name in LABELS:
        return f":doc:`{name} </theory/{LABELS[name]}>`"
    if name in PUBLIC:
        return f":py:obj:`~critflow.{name}`"
    return f"``{name}``"


def process(app, what, name, thing, options, lines):
    lines[:] = restructured(lines)


def setup(app):
    app.add_directive("layer", Layer)
    app.connect("autodoc-process-docstring", process)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
