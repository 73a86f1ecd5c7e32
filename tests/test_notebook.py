"""The notebook, run from beginning to end in a fresh kernel: what it prints and draws."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import numpy as np
import pytest

NOTEBOOK = Path(__file__).parent.parent / "examples" / "notebook.ipynb"


def code() -> list[str]:
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def test_it_has_at_most_30_lines_of_code():
    lines = [line for cell in code() for line in cell.splitlines() if line.strip()]
    assert len(lines) <= 30
    assert max(map(len, lines)) <= 120
    assert all(ast.parse(cell) for cell in code())


@pytest.mark.slow
def test_it_runs_and_its_answer_is_right(tmp_path, monkeypatch):
    import nbclient
    import nbformat

    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    _, asked, drawn, compared = (cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code")
    (answer_html,), (result_html,) = (
        [out["data"]["text/html"] for out in cell if "data" in out] for cell in (asked, compared)
    )
    assert "<svg" in answer_html
    assert "accuracy" in result_html
    assert {out["name"] for out in (*asked, *drawn, *compared) if "name" in out} == {"stdout"}
    said, _, place = asked[0]["text"].strip().partition("; taken in ")
    assert said.endswith(f": ok, in {place}")
    (figure,) = (out["data"]["application/vnd.plotly.v1+json"] for out in drawn)
    truth, answer = figure["data"][1:]
    assert (truth["name"], answer["name"]) == ("truth", "answer")
    assert np.hypot(truth["x"][0] - answer["x"][0], truth["y"][0] - answer["y"][0]) < 0.5
    accuracy = {row.split()[0]: float(row.split()[1]) for row in compared[0]["text"].splitlines()}
    assert accuracy["proposed"] > 0.9
    assert accuracy.keys() == {"proposed", "objects"}
