"""The figure of docs/question.md, by the code of that page: python docs/pictures/question.py [FILE]."""

import re
import sys
from pathlib import Path

page = (Path(__file__).parents[1] / "question.md").read_text(encoding="utf-8")
code = "".join(re.findall(r"^```python\n(.*?)^```$", page, flags=re.M | re.S))
file = sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).with_suffix(".png"))
exec(compile(code.replace('"question.png"', f"{file!r}, dpi=90"), "question.md", "exec"), {"__name__": "__main__"})
