"""The studies of the paper and what they share, such as `critflow.studies.shared.populations`.

An installed package holds them in this folder, a source checkout in `workflows/`.
"""

from pathlib import Path

__path__.append(str(Path(__file__).parents[2] / "workflows"))
