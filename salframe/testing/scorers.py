"""The rules of the role `scorer`."""

from __future__ import annotations

import tempfile
from pathlib import Path

from salframe.evaluation.scorer import Scorer
from salframe.framework.errors import DataError
from salframe.testing.asking import expect
from salframe.testing.rules import Rules


class ScorerRules(Rules[Scorer]):
    """A file that is no answer to the task is told of in one line, whatever is wrong with it."""

    def a_file_that_is_not_there_is_told(self) -> None:
        self._check("a file that is not there", None)

    def a_text_is_told(self) -> None:
        self._check("a text", "no answers")

    def an_empty_list_is_told(self) -> None:
        self._check("no answer at all", "[]")

    def _check(self, what: str, content: str | None) -> None:
        checked = f"score of {what}, in a folder without data"
        with tempfile.TemporaryDirectory() as folder:
            answers = Path(folder) / "answers.json"
            if content is not None:
                answers.write_text(content)
            try:
                rows = self.make().score(answers, Path(folder))
            except DataError as error:
                expect("\n" not in str(error), checked, "a DataError of several lines", "one line")
            except Exception as error:
                expect(False, checked, f"{type(error).__name__}: {error}", "DataError")
            else:
                expect(False, checked, f"{len(rows)} rows", "DataError")
