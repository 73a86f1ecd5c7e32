"""Rules of the roles between detections and an answer: `saliency`, `matcher`, `positioner`."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np

from salframe.framework.files.columns import read_columns
from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph, without_range
from salframe.graphs.matcher import GraphMatch, GraphMatcher, RankedGraphs
from salframe.graphs.saliency import SaliencyModel
from salframe.graphs.table import MappedGraphs, write_graphs
from salframe.localization.positioner import PoseEstimate, PoseStatus, Positioner
from salframe.panoramas.geometry import invert_pose, is_rigid, pose_2d, pose_errors, transform_points
from salframe.testing.expectations import DoesNotApply, attempt, call_twice, expect, same
from salframe.testing.rooms import ROOMS, box_detections, room_graph
from salframe.testing.rules import Rules

T_REFERENCE_QUERY = pose_2d(1.2, -0.7, 2.1)
REFERENCE_M = np.random.default_rng(0).uniform((-3, -3, -1), (3, 3, 1), (8, 3))
QUERY_M = transform_points(invert_pose(T_REFERENCE_QUERY), REFERENCE_M)
"""Eight points (8, 3) in the frame of the query, in metres. REFERENCE_M has the same points in the frame of the
reference panorama. Both are the input of positioners in the rules."""


class SaliencyRules(Rules[SaliencyModel]):
    """Every object has a saliency, with and without points, for many objects, one or none. The saliencies sum to 1."""

    def objects_of_a_room_have_shares(self) -> None:
        self._check("the objects of a room", box_detections(ROOMS[0]))

    def boxes_without_points_have_shares(self) -> None:
        self._check("boxes without points", replace(box_detections(ROOMS[0]), points_m=None))

    def few_objects_have_shares(self) -> None:
        self._check("one object", box_detections(ROOMS[0]).take([0]))
        self._check("no object", Detections.empty())

    def another_instance_gives_the_same_answer(self) -> None:
        objects = box_detections(ROOMS[0])
        first, second = (attempt("score", self.make().score, objects) for _ in range(2))
        expect(same(first, second), "score by another instance", "other shares", "the same shares")

    def _check(self, what: str, objects: Detections) -> None:
        checked = f"score of {what}"
        share = call_twice(checked, self.make().score, objects)
        fits = isinstance(share, np.ndarray) and share.shape == (len(objects),)
        expect(fits, checked, f"shape {np.shape(share)}", f"({len(objects)},)")
        expect(share.dtype == np.float64, checked, f"dtype {share.dtype}", "float64")
        expect((share >= 0).all(), checked, share, "shares that are at least 0")
        sums = not len(objects) or abs(share.sum() - 1) < 1e-9
        expect(sums, checked, f"a sum of {share.sum():.6g}", "shares that sum to 1")


class MatcherRules(Rules[GraphMatcher]):
    """If the map contains the graph of the query, this graph ranks first. Pairs are one-to-one. A query that shares no
    label with the map has no match. A query may have bearings only. A written index gives the same matches as the
    index in memory."""

    @cached_property
    def _graphs(self) -> list[SaliencyGraph]:
        """Graphs of the suite's rooms, of a room with fewer objects, and of an empty room."""
        sparse = replace(ROOMS[0], boxes=ROOMS[0].boxes[:-2])
        return [*map(room_graph, (*ROOMS, sparse)), room_graph(sparse.emptied())]

    @cached_property
    def _matcher(self) -> GraphMatcher:
        return self.make()

    @cached_property
    def _index(self) -> Any:
        return attempt(f"index of {len(self._graphs)} graphs", self._matcher.index, self._graphs)

    def the_graph_of_the_query_ranks_first(self) -> None:
        graphs = self._graphs
        for scene, room in enumerate(ROOMS):
            checked = f"match of the {room.name} among {len(graphs)} graphs"
            matches = self._match(checked, graphs[scene])
            received, expected = (
                [match.scene for match in matches],
                f"scene {scene} first, because its graph is the query",
            )
            expect(matches and matches[0].scene == scene, checked, received, expected)

    def rank_and_match_agree(self) -> None:
        for scene, room in enumerate(ROOMS):
            checked = f"rank of the {room.name} among {len(self._graphs)} graphs"
            arguments = self._graphs[scene], self._index, len(self._graphs)
            ranked = attempt(checked, self._matcher.rank, *arguments)
            matches = attempt(checked, self._matcher.match, *arguments)
            expect(isinstance(ranked, RankedGraphs), checked, type(ranked).__name__, "RankedGraphs")
            expect(
                ranked.scene.tolist() == [match.scene for match in matches]
                and np.allclose(ranked.score, [match.score for match in matches]),
                checked,
                f"scenes {ranked.scene.tolist()} with scores {ranked.score.tolist()}",
                "the scenes and scores of `match`",
            )
            poses = [np.full((4, 4), np.nan) if m.T_scene_query is None else m.T_scene_query for m in matches]
            fits = ranked.T_scene_query.shape == (len(matches), 4, 4)
            expect(
                fits and np.allclose(ranked.T_scene_query, np.reshape(poses, (-1, 4, 4)), equal_nan=True),
                checked,
                "other poses",
                "the poses of `match`, (T, 4, 4), NaN for a match without a pose",
            )

    def index_and_match_do_not_change_their_input(self) -> None:
        matcher, count = self._matcher, len(self._graphs)
        call_twice(
            "index and match", lambda graphs: matcher.match(graphs[0], matcher.index(graphs), count), self._graphs
        )

    def at_most_top_k_matches_are_returned(self) -> None:
        for scene, room in enumerate(ROOMS):
            checked = f"match of the {room.name} among {len(self._graphs)} graphs, top_k = 1"
            matches = attempt(checked, self._matcher.match, self._graphs[scene], self._index, 1)
            _check_matches(checked, matches, self._graphs[scene], self._graphs, 1)

    def another_instance_gives_the_same_answer(self) -> None:
        graphs, query = self._graphs, self._graphs[len(ROOMS) - 1]
        checked = f"match of the {ROOMS[-1].name} among {len(graphs)} graphs by another instance"
        first, second = (
            attempt(checked, lambda made: made.match(query, made.index(graphs), len(graphs)), self.make())
            for _ in range(2)
        )
        expect(same(first, second), checked, "other matches", "the same matches")

    def a_written_index_gives_the_same_matches(self) -> None:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_graphs(self._graphs, folder / "graphs")
            mapped = MappedGraphs(read_columns(folder / "graphs"))
            packed, query = list(mapped), self._graphs[0]
            built = attempt("index of packed graphs", self._matcher.index, packed)
            attempt("write_index", self._matcher.write_index, packed, folder / "index")
            other = self.make()
            opened = attempt("open_index", other.open_index, mapped, folder / "index")
            before, after = (
                attempt("match after open_index", matcher.match, query, index, len(packed))
                for matcher, index in ((self._matcher, built), (other, opened))
            )
            checked = "match after write_index and open_index"
            expect(same(before, after), checked, "other matches", "the matches of `index`")

    def a_query_may_lack_range(self) -> None:
        self._match("match of a graph without range", without_range(self._graphs[0]))

    def a_map_of_one_graph_is_matched(self) -> None:
        graph = self._graphs[0]
        alone = attempt("index of one graph", self._matcher.index, [graph])
        matches = attempt("match against one graph", self._matcher.match, graph, alone, 5)
        _check_matches("match against one graph", matches, graph, [graph], 5)

    def unrelated_queries_have_no_match(self) -> None:
        first = self._graphs[0]
        unrelated = replace(first, labels=tuple(f"unrelated {label}" for label in first.labels))
        for what, query in (
            ("a graph without objects", self._graphs[-1]),
            ("a graph whose labels the map lacks", unrelated),
        ):
            matches = self._query(f"match of {what}", query)
            expect(matches == [], f"match of {what}", f"{len(matches)} matches", "an empty list")

    def _match(self, checked: str, query: SaliencyGraph) -> list[GraphMatch]:
        matches = self._query(checked, query)
        _check_matches(checked, matches, query, self._graphs, len(self._graphs))
        return matches

    def _query(self, checked: str, query: SaliencyGraph) -> list[GraphMatch]:
        return call_twice(checked, lambda query: self._matcher.match(query, self._index, len(self._graphs)), query)


def _check_matches(
    checked: str, matches: list[GraphMatch], query: SaliencyGraph, graphs: Sequence[SaliencyGraph], top_k: int
) -> None:
    is_list = isinstance(matches, list) and all(isinstance(match, GraphMatch) for match in matches)
    expect(is_list, checked, type(matches).__name__, "a list of GraphMatch")
    expect(len(matches) <= top_k, checked, f"{len(matches)} matches", f"at most top_k = {top_k}")
    scenes, scores = [match.scene for match in matches], [match.score for match in matches]
    expect(
        len(set(scenes)) == len(scenes) and set(scenes) <= set(range(len(graphs))),
        checked,
        f"scenes {scenes}",
        f"different scenes below {len(graphs)}",
    )
    expect(
        np.isfinite(scores).all() and scores == sorted(scores, reverse=True),
        checked,
        f"scores {scores}",
        "finite scores, best first",
    )
    for match in matches:
        pairs, limits = match.pairs, (len(query), len(graphs[match.scene]))
        fits = isinstance(pairs, np.ndarray) and pairs.dtype.kind == "i" and pairs.ndim == 2 and pairs.shape[1] == 2
        expect(
            fits, checked, f"pairs of shape {np.shape(pairs)} and dtype {getattr(pairs, 'dtype', None)}", "(M, 2) int64"
        )
        expect(
            ((pairs >= 0) & (pairs < limits)).all(),
            checked,
            f"pairs {pairs.tolist()}",
            f"indices below {limits[0]} and {limits[1]}",
        )
        one_to_one = all(len(np.unique(side)) == len(pairs) for side in pairs.T)
        expect(one_to_one, checked, f"pairs {pairs.tolist()}", "one-to-one pairs")
        expect(
            match.T_scene_query is None or is_rigid(match.T_scene_query),
            checked,
            "a T_scene_query that is not a rigid motion",
            "a rigid motion of shape (4, 4) or None",
        )


class PositionerRules(Rules[Positioner]):
    """The pose is exact for points without noise, and for directions if the positioner supports them. It turns with the
    query. Too few or coincident points give a status instead of a pose."""

    def points_without_noise_give_the_exact_pose(self) -> None:
        for weights in (None, np.linspace(0.5, 1.5, len(REFERENCE_M))):
            checked = "solve of 8 points without noise" + ("" if weights is None else ", weighted")
            estimate = call_twice(checked, self.make().solve, QUERY_M, REFERENCE_M, weights)
            _check_exact(checked, estimate)

    def another_instance_gives_the_same_answer(self) -> None:
        first, second = (attempt("solve", self.make().solve, QUERY_M, REFERENCE_M) for _ in range(2))
        expect(same(first, second), "solve by another instance", "another pose", "the same pose")

    def the_pose_turns_with_the_query(self) -> None:
        if not self.make().is_equivariant:
            raise DoesNotApply(
                "is_equivariant of the positioner is False, so its heading need not follow a turn of the query exactly"
            )
        noisy_m = QUERY_M + np.random.default_rng(1).normal(0, 0.05, QUERY_M.shape)
        turn = pose_2d(0, 0, 2.0)
        before, after = (
            attempt("solve", self.make().solve, points_m, REFERENCE_M)
            for points_m in (noisy_m, transform_points(turn, noisy_m))
        )
        checked = "solve of 8 turned points with noise"
        expect(after.status is before.status, checked, f"the status '{after.status}'", f"'{before.status}' as before")
        if before.T_reference_query is not None:
            shift_m, turn_rad = pose_errors(after.T_reference_query @ turn, before.T_reference_query)
            received = f"a pose that is {shift_m:.2g} m and {turn_rad:.2g} rad off the turn"
            expect(max(shift_m, turn_rad) < 1e-6, checked, received, "the turned pose, or is_equivariant = False")

    def directions_without_noise_give_the_exact_pose(self) -> None:
        bearing = QUERY_M / np.linalg.norm(QUERY_M, axis=1, keepdims=True)
        checked = "resect of 8 directions without noise"
        estimate = call_twice(checked, self.make().resect, bearing, REFERENCE_M)
        _check_estimate(checked, estimate, len(REFERENCE_M))
        if estimate.status is PoseStatus.NO_RANGE:
            raise DoesNotApply("the positioner does not estimate poses from bearings alone")
        _check_exact(checked, estimate)

    def too_few_points_give_a_status(self) -> None:
        repeated = np.tile(QUERY_M[:1], (5, 1)), np.tile(REFERENCE_M[:1], (5, 1))
        failing = {
            "no point": (QUERY_M[:0], REFERENCE_M[:0]),
            "one point": (QUERY_M[:1], REFERENCE_M[:1]),
            "one point, repeated five times": repeated,
        }
        for what, (query, reference) in failing.items():
            checked = f"solve of {what}"
            estimate = call_twice(checked, self.make().solve, query, reference)
            _check_estimate(checked, estimate, len(query))
            failed = estimate.status is not PoseStatus.OK
            expect(failed, checked, "a pose", "a status that says why there is no pose")


def _check_exact(checked: str, estimate: PoseEstimate) -> None:
    _check_estimate(checked, estimate, len(REFERENCE_M))
    expect(estimate.T_reference_query is not None, checked, f"the status '{estimate.status}'", "the status 'ok'")
    shift_m, turn_rad = pose_errors(cast(np.ndarray, estimate.T_reference_query), T_REFERENCE_QUERY)
    received = f"a pose that is off by {shift_m:.2g} m and {np.degrees(turn_rad):.2g} deg"
    expect(max(shift_m, turn_rad) < 1e-6, checked, received, "the exact pose")


def _check_estimate(checked: str, estimate: PoseEstimate, count: int) -> None:
    expect(isinstance(estimate, PoseEstimate), checked, type(estimate).__name__, "PoseEstimate")
    pose, covariance, inliers = estimate.T_reference_query, estimate.covariance, estimate.inliers
    expect(
        (pose is not None) == (estimate.status is PoseStatus.OK),
        checked,
        f"the status '{estimate.status}' with{'out' * (pose is None)} a pose",
        "a pose if and only if the status is ok",
    )
    expect(pose is None or is_rigid(pose), checked, f"{pose}", "a rigid motion of shape (4, 4)")
    is_mask = isinstance(inliers, np.ndarray) and inliers.dtype == bool and inliers.shape == (count,)
    expect(is_mask, checked, f"inliers of shape {np.shape(inliers)}", f"({count},) bool")
    fits = covariance is None or (covariance.shape in ((3, 3), (6, 6)) and np.allclose(covariance, covariance.T))
    expect(fits, checked, f"the covariance {covariance}", "a symmetric matrix of shape (3, 3) or (6, 6), or None")
    expect(0 <= estimate.runner_up <= 1, checked, f"runner_up {estimate.runner_up}", "a number from 0 to 1")
