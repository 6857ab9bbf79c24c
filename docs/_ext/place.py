"""Which documents are made: those of critflow in docs/, or those of critflow-extras in extras/docs.

`extras/docs/conf.py` and the tests of the extras set these two before any other module of this folder is imported.
"""

from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PACKAGE = "critflow"
