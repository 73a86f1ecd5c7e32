"""Conformance rules for components of the role `scorer`."""

from __future__ import annotations

import tempfile
from pathlib import Path

from salframe.evaluation.scorer import Scorer
from salframe.framework.errors import DataError
from salframe.testing.expectations import expect
from salframe.testing.rules import Rules


class ScorerRules(Rules[Scorer]):
    """Conformance tests of a scorer: if the answer file is not in the format of the benchmark, `score` raises a
    DataError whose message is one line."""

    def a_missing_file_raises_an_error(self) -> None:
        self._check("a missing file", None)

    def plain_text_raises_an_error(self) -> None:
        self._check("a plain text file", "no answers")

    def an_empty_list_raises_an_error(self) -> None:
        self._check("an empty list", "[]")

    def _check(self, what: str, content: str | None) -> None:
        checked = f"score of {what}, in a folder without data"
        with tempfile.TemporaryDirectory() as folder:
            answers = Path(folder) / "answers.json"
            if content is not None:
                answers.write_text(content)
            try:
                rows = self.make().score(answers, Path(folder))
            except DataError as error:
                expect("\n" not in str(error), checked, "a DataError of several lines", "a DataError of one line")
            except Exception as error:
                expect(False, checked, f"{type(error).__name__}: {error}", "DataError")
            else:
                expect(False, checked, f"{len(rows)} rows", "DataError")
