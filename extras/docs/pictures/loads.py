"""The picture of howto/loads.md, by the code of that page: python extras/docs/pictures/loads.py [FILE]."""

import contextlib
import re
import sys
import tempfile
from pathlib import Path

page = (Path(__file__).parents[1] / "howto" / "loads.md").read_text(encoding="utf-8")
code = "".join(re.findall(r"^```python\n(.*?)^```$", page, flags=re.M | re.S))
file = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png")).absolute()
# The page writes a file of the drawing.
with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
    exec(compile(code.replace('"loads.png"', f"{str(file)!r}"), "loads.md", "exec"), {"__name__": "__main__"})
