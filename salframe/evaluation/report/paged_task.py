"""Base class of tasks whose runs have an HTML page."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from salframe.evaluation.report.arms import Arm, find_entries, name_arms
from salframe.evaluation.report.content import make_content
from salframe.evaluation.report.page import write_page
from salframe.evaluation.report.view import RunView
from salframe.evaluation.runs.records import Piece, PieceRowT, Record, Surveyed
from salframe.evaluation.runs.task import LineT, Result, Task
from salframe.panoramas.opening import Progress

PAGE = "report.html"
"""File name of the HTML page in a run folder."""


@dataclass(frozen=True, eq=False)
class Islands:
    """Content of an HTML page that the browser reads on demand.

    Attributes:
        parts: Pairs of an id and a text: JSON, or a data URL.
        notes: Notes on content that could not be drawn.
    """

    parts: Iterator[tuple[str, str]]
    notes: tuple[str, ...] = ()


class PagedTask(Task[Piece, Surveyed, PieceRowT, LineT]):
    """A task whose runs have an HTML page. `about` is a note on the columns of its tables."""

    about: ClassVar[str]

    @abstractmethod
    def view(
        self, result: Result[LineT], records: Sequence[Record[PieceRowT]], survey: Surveyed
    ) -> RunView[PieceRowT, LineT]:
        """Return the data of a run from which its HTML page is made."""

    @classmethod
    def part(cls, views: Sequence[Any], arms: Sequence[Arm]) -> dict[str, Any]:
        """Return the content of the HTML page that only this task has, as JSON; empty by default. `arms` are the
        methods with their settings.

        The key "figures" has a list of figures (`figures.Figure`: title, data, layout). The scripts of the page read
        the other keys.
        """
        return {}

    @classmethod
    def islands(
        cls, views: Sequence[Any], arms: Sequence[Arm], full: bool, progress: Progress | None = None
    ) -> Islands | None:
        """Return the details of each query, pair or episode that the HTML page of the run shows; None: no details
        (default).

        `arms` are the methods with their settings. `full` shows panoramas in full resolution instead of thumbnails.
        """
        return None

    @classmethod
    def content(
        cls, views: Sequence[RunView[PieceRowT, LineT]], arms: Sequence[Arm], columns: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Return the content of the HTML page of runs (`views`) as JSON. `arms` are the methods with their settings.
        `columns` are the names of the columns of the first table; empty for the default columns."""
        return {**make_content(views, arms, cls.about, columns), **cls.part(views, arms)}

    def write_page(self, result: Result[LineT], records: Sequence[Record[PieceRowT]], survey: Surveyed) -> Path:
        view = self.view(result, records, survey)
        path = result.run / PAGE
        write_page(path, self.content([view], name_arms([view], find_entries([view]), result.rows)))
        return path
