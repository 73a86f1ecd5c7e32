"""The rules of the role `scene-index`."""

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
from salframe.testing.asking import ask, attempt, expect, same
from salframe.testing.rooms import ROOMS, room_graph
from salframe.testing.rules import Rules


class SceneIndexRules(Rules[SceneIndex]):
    """A scene is found among others, and twice where it is there twice, in order; an index is built from a stream,
    appears whole, answers the same to whoever opens it, and goes on when its folder is removed."""

    @cached_property
    def _graphs(self) -> list[SaliencyGraph]:
        """Those of the suite's rooms, of a room with nothing, and of the first room once more."""
        return [*map(room_graph, (*ROOMS, ROOMS[0].emptied(), ROOMS[0]))]

    @cached_property
    def _folder(self) -> tempfile.TemporaryDirectory[str]:
        return tempfile.TemporaryDirectory()

    @cached_property
    def _index(self) -> SceneIndex:
        """The index of all graphs, opened."""
        return self._built(self._graphs, "index")

    def _built(self, graphs: Sequence[SaliencyGraph], name: str) -> SceneIndex:
        index, folder = self.make(), Path(self._folder.name) / name
        attempt(f"build of {len(graphs)} graphs", index.build, iter(graphs), folder)
        attempt(f"open of {len(graphs)} graphs", index.open, folder)
        return index

    def a_scene_is_found_among_others(self) -> None:
        for scene, room in enumerate(ROOMS):
            checked = f"candidates of the {room.name} among {len(self._graphs)} graphs"
            found = self._ask(checked, self._graphs[scene], len(self._graphs)).scene.tolist()
            expect(found[:1] == [scene], checked, f"scenes {found}", f"the same graph, {scene}, first")

    def of_equal_scores_the_lower_number_comes_first(self) -> None:
        first, again = 0, len(self._graphs) - 1
        checked = "candidates of a room that is in the map twice"
        found = self._ask(checked, self._graphs[first], len(self._graphs))
        expect(found.scene[:2].tolist() == [first, again], checked, found.scene.tolist(), f"{first}, {again} first")
        expect(found.score[0] == found.score[1], checked, f"scores {found.score[:2].tolist()}", "equal ones")

    def fewer_candidates_are_the_first_of_more(self) -> None:
        for scene, room in enumerate(ROOMS):
            checked = f"candidates of the {room.name}"
            every = self._ask(checked, self._graphs[scene], len(self._graphs))
            for count in range(1, len(every)):
                some = self._ask(f"{count} {checked}", self._graphs[scene], count)
                leading = SceneCandidates(every.scene[:count], every.score[:count])
                expect(same(some, leading), f"{count} {checked}", some.scene.tolist(), f"{leading.scene.tolist()}")

    def a_query_may_lack_range(self) -> None:
        self._ask("candidates of a graph without range", without_range(self._graphs[0]), len(self._graphs))

    def nothing_in_common_is_no_candidate(self) -> None:
        first = self._graphs[0]
        strange = replace(first, labels=tuple(f"strange {label}" for label in first.labels))
        for what, query in (
            ("a graph without objects", room_graph(ROOMS[0].emptied())),
            ("a graph whose labels the map lacks", strange),
        ):
            checked = f"candidates of {what}"
            expect(not len(self._ask(checked, query, len(self._graphs))), checked, "some", "none")

    def maps_of_one_scene_and_of_none_are_indexed(self) -> None:
        first = self._graphs[0]
        for count in (1, 0):
            found = self._built(self._graphs[:count], f"map of {count}").candidates(first, 5).scene.tolist()
            expect(found == [0] * count, f"candidates in a map of {count} scenes", found, f"{[0] * count}")

    def another_instance_that_opens_it_answers_the_same(self) -> None:
        ours, other = self._index, self.make()
        attempt("open by another instance", other.open, Path(self._folder.name) / "index")
        one, two = (attempt("candidates", index.candidates, self._graphs[0], 5) for index in (ours, other))
        expect(same(one, two), "candidates by another instance", "others", "the same")

    def an_open_index_outlives_its_folder(self) -> None:
        index = self._built(self._graphs, "removed")
        shutil.rmtree(Path(self._folder.name) / "removed", ignore_errors=True)  # Windows holds on to files in use
        one, two = (attempt("candidates", made.candidates, self._graphs[0], 5) for made in (self._index, index))
        expect(same(one, two), "candidates of an open index whose folder was removed", "others", "the same")

    def an_index_appears_whole(self) -> None:
        folder = Path(self._folder.name) / "cut short"

        def cut_short() -> Iterator[SaliencyGraph]:
            yield self._graphs[0]
            raise EOFError

        try:
            self.make().build(cut_short(), folder)
        except EOFError:
            expect(not folder.exists(), "build of a stream that breaks off", "a folder", "none")
        else:
            expect(False, "build of a stream that breaks off", "no error", "the stream's own")
        self._refuses("open of a folder that is not there", DataError, self.make().open, folder)

    def a_folder_that_is_there_is_refused(self) -> None:
        folder = Path(self._folder.name)
        self._refuses("build into a folder that is there", ConfigError, self.make().build, iter(self._graphs), folder)

    def _refuses(self, checked: str, error: type[Exception], function: object, *given: object) -> None:
        try:
            function(*given)  # type: ignore[operator]
        except error:
            return
        expect(False, checked, "no error", error.__name__)

    def _ask(self, checked: str, query: SaliencyGraph, count: int) -> SceneCandidates:
        found = ask(checked, lambda query: self._index.candidates(query, count), query)
        expect(isinstance(found, SceneCandidates), checked, type(found).__name__, "SceneCandidates")
        kinds = (found.scene.dtype, found.score.dtype, found.scene.ndim, found.score.shape == found.scene.shape)
        expect(kinds == (np.int64, np.float64, 1, True), checked, f"{kinds}", "scene (K,) int64, score (K,) float64")
        expect(len(found) <= count, checked, f"{len(found)} scenes", f"at most {count}")
        scenes = found.scene.tolist()
        distinct = len(set(scenes)) == len(scenes) and set(scenes) <= set(range(len(self._graphs)))
        expect(distinct, checked, f"scenes {scenes}", f"different ones below {len(self._graphs)}")
        ordered = np.isfinite(found.score).all() and (np.diff(found.score) <= 0).all()
        expect(ordered, checked, f"scores {found.score.tolist()}", "finite ones, best first")
        return found
