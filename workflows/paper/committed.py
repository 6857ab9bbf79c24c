"""The verdicts of the committed runs in words, from `committed.json`, which `python -m workflows.pages.tables` writes.

The results themselves are in `results/reference/` of the repository, without which the studies can be installed.
"""

import json
from pathlib import Path

_FILE = Path(__file__).with_suffix(".json")


def committed_run(study: str) -> str:
    """The verdicts of the committed run of a study, empty if it has none."""
    return json.loads(_FILE.read_text(encoding="utf-8")).get(study, "")
