"""The counts of `.ci/counters` that need no run of code do not exceed their ceilings; `.ci/run` asserts all."""

import subprocess
import sys
from pathlib import Path


def test_no_count_of_the_text_exceeds_its_ceiling():
    script = Path(__file__).parent.parent / ".ci" / "counters"
    done = subprocess.run([sys.executable, script, "--static"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "statements" in done.stdout
