"""The picture of howto/local.md, by gallery/allostery.py: python extras/docs/pictures/responses.py [FILE]."""

import contextlib
import runpy
import shutil
import sys
import tempfile
from pathlib import Path

script = Path(__file__).parents[1].resolve() / "gallery" / "allostery.py"
file = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png")).absolute()
# The script writes its picture here.
with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
    runpy.run_path(str(script), run_name="__main__")
    shutil.copy("allostery.png", file)
