"""The rules of the role `scorer`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from salframe.evaluation.scorer import Scorer
from salframe.framework.errors import DataError
from salframe.testing.asking import expect


def check_scorer(make: Callable[[], Scorer]) -> None:
    """A file that is no answer to the task is told of in one line, whatever is wrong with it."""
    scorer = make()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "words.json").write_text("no answers")
        (root / "nothing.json").write_text("[]")
        for name, what in (
            ("absent.json", "a file that is not there"),
            ("words.json", "a text"),
            ("nothing.json", "no answer at all"),
        ):
            checked = f"score of {what}, in a folder without data"
            try:
                rows = scorer.score(root / name, root)
            except DataError as error:
                expect("\n" not in str(error), checked, "a DataError of several lines", "one line")
            except Exception as error:
                expect(False, checked, f"{type(error).__name__}: {error}", "DataError")
            else:
                expect(False, checked, f"{len(rows)} rows", "DataError")
