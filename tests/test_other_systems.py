"""What differs between systems, tried on this one: no Unix module is needed, and no locale of UTF-8."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from salframe.evaluation.runs import memory

WITHOUT_UNIX = """
import sys
sys.modules.update(dict.fromkeys(("fcntl", "grp", "pwd", "resource")))
from salframe.cli import main
main()
"""
COMPARE = ("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline", "--reported")


def test_methods_are_compared_without_unix_modules_in_the_encoding_of_windows(tmp_path):
    """The figures of the paper and the report hold letters that ASCII has not."""
    environment = {
        **os.environ,
        "SALFRAME_PLUGINS": "fake_plugin,salframe_engines,salframe.configs",
        "SALFRAME_CACHE": str(tmp_path / "cache"),
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]),
        "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
        "PYTHONIOENCODING": "cp1252",
        "LC_ALL": "C",
    }
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_UNIX, *COMPARE], cwd=tmp_path, env=environment, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Scene Representation using 360° Saliency Graph" in done.stdout.decode("cp1252")
    (report,) = tmp_path.glob("runs/*/report.html")
    assert "°" in report.read_text(encoding="utf-8")


def test_peak_memory_is_unknown_where_no_module_tells_it(monkeypatch, tmp_path):
    monkeypatch.setattr(memory, "in_worker", lambda: True)
    assert memory.peak_memory_mb() > 10
    monkeypatch.setattr(memory, "Path", lambda _: tmp_path / "no proc")
    by_resource = memory.peak_memory_mb()
    assert by_resource > 10
    monkeypatch.setitem(sys.modules, "resource", None)
    assert memory.peak_memory_mb() is None
