"""What `import salframe` costs: a tenth of a second is promised, with the interpreter's own start."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.slow
def test_import(benchmark):
    benchmark(subprocess.run, [sys.executable, "-c", "import salframe"], check=True)
