"""Conformance rules for components of the role `scene-index`."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from salframe.framework.errors import ConfigError, DataError
from salframe.graphs.graph import SaliencyGraph, without_range
from salframe.graphs.scene_index import SceneCandidates, SceneIndex
from salframe.testing.expectations import attempt, call_twice, expect, same
from salframe.testing.rooms import ROOMS, room_graph
from salframe.testing.rules import Rules


class SceneIndexRules(Rules[SceneIndex]):
    """A scene is the graph of a reference frame. The scene of the query ranks first, and equal scores are in the order
    of the map. An index is built from a stream and written atomically, gives the same candidates to every instance, and
    works after its folder was removed."""

    @cached_property
    def _graphs(self) -> list[SaliencyGraph]:
        """Graphs of the suite's rooms, of an empty room, and of the first room again."""
        return [*map(room_graph, (*ROOMS, ROOMS[0].emptied(), ROOMS[0]))]

    @cached_property
    def _folder(self) -> tempfile.TemporaryDirectory[str]:
        return tempfile.TemporaryDirectory()

    @cached_property
    def _index(self) -> SceneIndex:
        """Opened index of all graphs."""
        return self._build(self._graphs, "index")

    def _build(self, graphs: Sequence[SaliencyGraph], name: str) -> SceneIndex:
        index, folder = self.make(), Path(self._folder.name) / name
        attempt(f"build of {len(graphs)} graphs", index.build, iter(graphs), folder)
        attempt(f"open of {len(graphs)} graphs", index.open, folder)
        return index

    def the_scene_of_the_query_ranks_first(self) -> None:
        for scene, room in enumerate(ROOMS):
            checked = f"candidates of the {room.name} among {len(self._graphs)} graphs"
            scenes = self._query(checked, self._graphs[scene], len(self._graphs)).scene.tolist()
            expect(
                scenes[:1] == [scene],
                checked,
                f"scenes {scenes}",
                f"scene {scene} first, because its graph is the query",
            )

    def equal_scores_are_in_the_order_of_the_map(self) -> None:
        first, second = 0, len(self._graphs) - 1
        checked = "candidates of a room that is in the map twice"
        candidates = self._query(checked, self._graphs[first], len(self._graphs))
        expect(
            candidates.scene[:2].tolist() == [first, second],
            checked,
            candidates.scene.tolist(),
            f"{first}, {second} first",
        )
        expect(
            candidates.score[0] == candidates.score[1],
            checked,
            f"scores {candidates.score[:2].tolist()}",
            "equal scores",
        )

    def fewer_candidates_are_the_first_of_many(self) -> None:
        for scene, room in enumerate(ROOMS):
            checked = f"candidates of the {room.name}"
            candidates = self._query(checked, self._graphs[scene], len(self._graphs))
            for count in range(1, len(candidates)):
                fewer = self._query(f"{count} {checked}", self._graphs[scene], count)
                leading = SceneCandidates(candidates.scene[:count], candidates.score[:count])
                expect(same(fewer, leading), f"{count} {checked}", fewer.scene.tolist(), f"{leading.scene.tolist()}")

    def a_query_may_lack_range(self) -> None:
        self._query("candidates of a graph without range", without_range(self._graphs[0]), len(self._graphs))

    def unrelated_queries_have_no_candidates(self) -> None:
        first = self._graphs[0]
        unrelated = replace(first, labels=tuple(f"unrelated {label}" for label in first.labels))
        for what, query in (
            ("a graph without objects", room_graph(ROOMS[0].emptied())),
            ("a graph whose labels the map lacks", unrelated),
        ):
            checked = f"candidates of {what}"
            count = len(self._query(checked, query, len(self._graphs)))
            expect(not count, checked, f"{count} candidates", "no candidates")

    def maps_of_one_scene_and_of_no_scene_are_indexed(self) -> None:
        first = self._graphs[0]
        for count in (1, 0):
            scenes = self._build(self._graphs[:count], f"map of {count}").candidates(first, 5).scene.tolist()
            expect(scenes == [0] * count, f"candidates in a map of {count} scenes", scenes, f"{[0] * count}")

    def another_instance_gives_the_same_candidates(self) -> None:
        first, second = self._index, self.make()
        attempt("open by another instance", second.open, Path(self._folder.name) / "index")
        before, after = (attempt("candidates", index.candidates, self._graphs[0], 5) for index in (first, second))
        expect(same(before, after), "candidates by another instance", "other candidates", "the same candidates")

    def an_open_index_works_without_its_folder(self) -> None:
        index = self._build(self._graphs, "removed")
        shutil.rmtree(Path(self._folder.name) / "removed", ignore_errors=True)  # Windows cannot delete open files
        before, after = (attempt("candidates", made.candidates, self._graphs[0], 5) for made in (self._index, index))
        checked = "candidates of an open index whose folder was removed"
        expect(same(before, after), checked, "other candidates", "the same candidates")

    def an_index_is_written_atomically(self) -> None:
        folder = Path(self._folder.name) / "cut short"

        def cut_short() -> Iterator[SaliencyGraph]:
            yield self._graphs[0]
            raise EOFError

        try:
            self.make().build(cut_short(), folder)
        except EOFError:
            expect(not folder.exists(), "build from a stream that raises", "an incomplete folder", "no folder")
        else:
            expect(False, "build from a stream that raises", "no error", "the exception of the stream")
        self._expect_error("open of a folder that does not exist", DataError, self.make().open, folder)

    def an_existing_folder_is_rejected(self) -> None:
        folder = Path(self._folder.name)
        self._expect_error("build into an existing folder", ConfigError, self.make().build, iter(self._graphs), folder)

    def _expect_error(self, checked: str, error: type[Exception], function: object, *arguments: object) -> None:
        try:
            function(*arguments)  # type: ignore[operator]
        except error:
            return
        expect(False, checked, "no error", error.__name__)

    def _query(self, checked: str, query: SaliencyGraph, count: int) -> SceneCandidates:
        candidates = call_twice(checked, lambda query: self._index.candidates(query, count), query)
        expect(isinstance(candidates, SceneCandidates), checked, type(candidates).__name__, "SceneCandidates")
        kinds = (
            candidates.scene.dtype,
            candidates.score.dtype,
            candidates.scene.ndim,
            candidates.score.shape == candidates.scene.shape,
        )
        expect(kinds == (np.int64, np.float64, 1, True), checked, f"{kinds}", "scene (K,) int64, score (K,) float64")
        expect(len(candidates) <= count, checked, f"{len(candidates)} scenes", f"at most {count}")
        scenes = candidates.scene.tolist()
        distinct = len(set(scenes)) == len(scenes) and set(scenes) <= set(range(len(self._graphs)))
        expect(distinct, checked, f"scenes {scenes}", f"different scenes below {len(self._graphs)}")
        ordered = np.isfinite(candidates.score).all() and (np.diff(candidates.score) <= 0).all()
        expect(ordered, checked, f"scores {candidates.score.tolist()}", "finite scores, best first")
        return candidates
