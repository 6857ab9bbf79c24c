"""The API reference: a page for each function and class, and lists of them.

The directive `layer` lists the names of one module of critflow, or of one folder of critflow-extras, with a line each;
`names` lists all public names of the package by the headings of the reference.  `entries.py` writes their
pages.

Docstrings are plain text.  Tables of two columns become definition lists, indented lines displayed equations, lines
after `>>>` code, and `names` links: to a public name, or to the page that explains the equation of the paper with this
label.  In the pages of the theory `LAYER: NAME` links to its entry, where it is one of the package.
"""

import inspect
import re
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import ClassVar, NamedTuple

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from equations import tex_of
from place import DOCS, PACKAGE
from sphinx import addnodes
from sphinx.transforms import SphinxTransform

from workflows.pages.paper import EQUATIONS, printed

ROW = re.compile(r"([^\s.]+(?:,? [^\s.]+){0,4}) {2,}(\S.*)")  # not two sentences
THEORY, REFERENCE = DOCS / "theory", DOCS / "reference"
ENTRIES = "entries"  # the folder of the pages of the names, in that of the reference
BLOCK = re.compile(r"^(#+) (.+)$|^```\{layer\} (\w+)\n(?::first: (.*)\n)?([^`]*)```$", flags=re.M)
# The pages that explain the equations; others are those of the other documents.
PAGES = {equation.label: equation.page for equation in EQUATIONS if (THEORY / f"{equation.page}.md").exists()}
PRINTED = {equation.label for equation in EQUATIONS}
FUNCTION = re.compile(r"(\w+): (\w+(?:\.\w+)*)")  # of a layer, in the tables of the theory
CLASS = "   :members:\n   :member-order: bysource\n   :exclude-members: __init__, __new__\n"


package = import_module(PACKAGE)
PUBLIC = package.__all__
FOLDER = Path(package.__file__).parent


def files_of(layer: str) -> list[Path]:
    """The file of a module of critflow, or those of a folder of critflow-extras; none where neither is there."""
    return sorted((FOLDER / layer).glob("*.py")) or sorted(FOLDER.glob(f"{layer}.py"))


def within(module: str, layer: str) -> bool:
    """Whether a module is of a layer."""
    return f"{module}.".startswith(f"{PACKAGE}.{layer}.")


def public_names(layer: str) -> list[str]:
    """The public names that are defined in this layer, in the order of their modules and lines."""
    found = []
    for name in PUBLIC:
        thing = inspect.unwrap(getattr(package, name))
        if within(thing.__module__, layer):
            found.append((thing.__module__, inspect.getsourcelines(thing)[1], name))
    return [name for *_, name in sorted(found)]


def results_of(names: list[str]) -> list[str]:
    """The classes that these functions return and that are not public names themselves."""
    found: dict[str, None] = {}
    for name in names:
        thing = inspect.unwrap(getattr(package, name))
        returned = str(getattr(thing, "__annotations__", {}).get("return", ""))
        for word in re.findall(r"[A-Z]\w+", returned):
            kind = getattr(import_module(thing.__module__), word, None)
            if inspect.isclass(kind) and kind.__module__.startswith(f"{PACKAGE}.") and word not in PUBLIC:
                found[f"{kind.__module__}.{word}"] = None
    return list(found)


def path_of(layer: str, name: str) -> str:
    """Where the reference documents a name of a layer: `PACKAGE.NAME` if it is public, else in its module."""
    head, _, member = name.partition(".")
    if head in PUBLIC:
        owner_path = f"{PACKAGE}.{head}"
    else:
        defined = re.compile(rf"^(?:def|class) {head}\b", flags=re.M)
        file = next((file for file in files_of(layer) if defined.search(file.read_text(encoding="utf-8"))), None)
        if file is None:  # MODULE.NAME
            return f"{PACKAGE}.{layer}.{name}"
        owner_path = ".".join([*file.relative_to(FOLDER.parent).with_suffix("").parts, head])
    owners = getattr(thing_at(owner_path), "__mro__", ())
    owner = next((kind for kind in owners if member and member in vars(kind)), None)
    if owner is None or owner is owners[0]:
        return f"{owner_path}.{member}".rstrip(".")
    return f"{owner.__module__}.{owner.__name__}.{member}"


def in_theory(layer: str) -> list[str]:
    """The functions and classes of this layer that pages of the theory name and that are not public."""
    text = "".join(page.read_text(encoding="utf-8") for page in sorted(THEORY.glob("*.md")))
    found = re.findall(rf"`{layer}: (\w+(?:\.[a-z]\w*)*)", text)
    paths = [path_of(layer, name).split(".") for name in found]
    depth = 4 if (FOLDER / layer).is_dir() else 3  # of the name in its module
    return [".".join(path[:depth]) for path in paths if within(".".join(path[:-1]), layer) and len(path) >= depth]


def autodoc(path: str) -> str:
    """The directive of autodoc that documents this object."""
    thing = thing_at(path)
    if inspect.isclass(thing):
        values = "   :undoc-members:\n" if issubclass(thing, Enum) else ""
        return f".. autoclass:: {path}\n{CLASS}{values}"
    return f".. autofunction:: {path}\n"


def thing_at(path: str):
    module, _, name = path.rpartition(".")
    return getattr(import_module(module), name)


def summary(paths: list[str]) -> str:
    """A table of these names and the first line of their docstrings."""
    rows = [".. list-table::", "   :widths: auto", "   :class: summary", ""]
    for path in paths:
        first = (inspect.getdoc(inspect.unwrap(thing_at(path))) or "").split("\n\n")[0].replace("\n", " ")
        rows += [f"   * - :py:obj:`~{path}`", f"     - {escaped(first)}"]
    return "\n".join([*rows, ""])


class Listed(NamedTuple):
    """A directive `layer` of the reference: its page, the heading above it, and the paths of its names in order."""

    page: str
    heading: str
    paths: list[str]


def paths_of(layer: str, first: list[str], others: list[str]) -> list[str]:
    """The names that the reference documents of a layer: those of `first`, the other public names, the classes that
    they return, those that are listed as MODULE.NAME, and those that the theory names."""
    public = public_names(layer)
    paths = [f"{PACKAGE}.{name}" for name in [*first, *public]]
    paths += [path for path in results_of(public) if within(path.rpartition(".")[0], layer)]
    paths += [f"{PACKAGE}.{layer}.{name}" for name in others]
    return list(dict.fromkeys([*paths, *in_theory(layer)]))


def listed() -> list[Listed]:
    """All directives `layer` of the reference, in the order of its index."""
    index = (REFERENCE / "index.md").read_text(encoding="utf-8")
    pages = dict.fromkeys([*re.findall(r"\]\((\w+)\.md\)", index), "index"])
    found = []
    for page in pages:
        heading = ""
        for block in BLOCK.finditer((REFERENCE / f"{page}.md").read_text(encoding="utf-8")):
            heading = block[2] or heading
            if layer := block[3]:
                found.append(Listed(page, heading, paths_of(layer, (block[4] or "").split(), block[5].split())))
    return found


def entry_of(path: str) -> str:
    """The name of the page of a function or class: that of `PACKAGE.NAME`, or MODULE.NAME in it.

    Files such as those of `quantity` and `Quantity` would be one on some disks.
    """
    name = path.removeprefix(f"{PACKAGE}.")
    return f"{name}_class" if name != name.lower() and name.lower() in PUBLIC else name


class Layer(Directive):
    """`layer NAME`: a table of the names of a module or a folder, with a line of each, which lead to their pages."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar = {"first": str.split}

    def run(self):
        layer = self.arguments[0]
        return parsed(self, summary(paths_of(layer, self.options.get("first", []), " ".join(self.content).split())))


class Names(Directive):
    """`names`: a table of the public names below each heading of the reference."""

    def run(self):
        parts = []
        for page, heading, paths in listed():
            if public := [path for path in paths if path.count(".") == 1]:
                parts += [f".. rubric:: :doc:`{heading} <{page}>`", "", summary(public)]
        return parsed(self, "\n".join(parts))


def parsed(directive: Directive, text: str) -> list[nodes.Node]:
    """The nodes of reStructuredText in a page of Markdown."""
    container = nodes.container()
    lines = StringList(["````{eval-rst}", *text.splitlines(), "````"], source=directive.name)
    directive.state.nested_parse(lines, 0, container)
    return container.children


class FunctionLinks(SphinxTransform):
    """In the theory `LAYER: NAME` links to the entry of the reference; one of the other package is its name."""

    default_priority = 850

    def apply(self, **kwargs):
        if not self.env.docname.startswith("theory/"):
            return
        for literal in list(self.document.findall(nodes.literal)):
            found = FUNCTION.fullmatch(literal.astext())
            if found and found[1] != "workflows" and not files_of(found[1]):
                literal.parent.replace(literal, nodes.literal("", found[2]))
            elif found and files_of(found[1]):
                target = path_of(*found.groups())
                link = addnodes.pending_xref("", refdomain="py", reftype="obj", reftarget=target, refwarn=True)
                link += nodes.literal("", found[2])
                literal.parent.replace(literal, link)


def restructured(lines: list[str]) -> list[str]:
    """A docstring in plain text as reStructuredText."""
    made: list[str] = []
    column = 0  # of the second column, inside a table
    example = False
    for line in lines:
        if line.startswith(">>>") and not example:
            made += ["", ".. code-block:: pycon", ""]
        example = line.startswith(">>>") or (example and bool(line.strip()))
        if example:
            made.append(f"   {line}")
            continue
        row = ROW.fullmatch(line)
        indent = len(line) - len(line.lstrip())
        if column and line and indent >= column:
            made[-1] += " " + escaped(line.strip())
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
            part = re.sub(r"([|*\\_])", r"\\\1", part)
            parts[at] = re.sub(r"\^\{([^}]*)\}", r"\\ :sup:`\1`\\ ", part)
        else:
            parts[at] = reference(part.strip("`"))
    return "".join(parts)


def reference(name: str) -> str:
    if name in PAGES:
        return f":doc:`{printed(name)} </theory/{PAGES[name]}>`"
    if name in PRINTED:
        return printed(name)
    head, _, member = name.partition(".")
    path = documented().get(head)
    if path and not member:
        return f":py:obj:`~{path}`"
    if path and member in vars(thing_at(path)):
        return f":py:obj:`{name} <{path}.{member}>`"
    return f"``{name}``"


@cache
def documented() -> dict[str, str]:
    """The path of each name with a page: no two pages have one name."""
    return {path.rpartition(".")[2]: path for layer in listed() for path in layer.paths}


def process(app, what, name, thing, options, lines):
    lines[:] = restructured(lines)


def shortened(app, what, name, thing, options, signature, returned):
    """Arrays by the names of their aliases."""

    def short(text):
        text = re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text or "")
        return re.sub(r"[~\w.]*ndarray\[tuple\[[~\w.]*Any, \.\.\.\], [~\w.]*dtype\[[~\w.]+\]\]", "Array", text)

    return (short(signature), short(returned) or None) if signature else None


def setup(app):
    app.add_directive("layer", Layer)
    app.add_directive("names", Names)
    app.add_transform(FunctionLinks)
    app.connect("autodoc-process-docstring", process)
    app.connect("autodoc-process-signature", shortened)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
