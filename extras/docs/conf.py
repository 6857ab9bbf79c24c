"""The site of the extras, by the settings of that of critflow: sphinx-build -W extras/docs extras/docs/_build/site."""

import runpy
from pathlib import Path

SETTINGS = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "conf.py"))
globals().update({name: value for name, value in SETTINGS.items() if not name.startswith("__")})

import place  # noqa: E402 (in a folder that the settings add to the path)

place.DOCS, place.PACKAGE = Path(__file__).parent, "critflow_extras"
project = "critflow-extras"
html_title = f"critflow-extras {release}"  # noqa: F821
