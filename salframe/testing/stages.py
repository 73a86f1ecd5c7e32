"""The rules of the roles between detections and an answer: `saliency`, `matcher`, `positioner`, `planner`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from salframe.framework.errors import NoRoute
from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.matcher import GraphMatch, GraphMatcher
from salframe.graphs.saliency import SaliencyModel
from salframe.localization.positioner import PoseEstimate, PoseStatus, Positioner
from salframe.panoramas.geometry import invert_pose, is_rigid, pose_2d, pose_errors, transform_points
from salframe.testing.asking import ask, attempt, expect, same
from salframe.testing.rooms import ROOMS, box_detections, room_graph, without_range
from salframe.topology.planner import Planner, Route
from salframe.topology.topological_map import MapEdge, MapNode, NodeKind, TopologicalMap


def check_saliency(make: Callable[[], SaliencyModel]) -> None:
    """A share of each object, with its points and with its box alone, whether there are many, one or none."""
    model, objects = make(), box_detections(ROOMS[0])
    cases = {
        "the objects of a room": objects,
        "boxes without points": replace(objects, points_m=None),
        "one object": objects.take([0]),
        "no object": Detections.empty(),
    }
    for what, given in cases.items():
        checked = f"score of {what}"
        share = ask(checked, model.score, given)
        expect(
            isinstance(share, np.ndarray) and share.shape == (len(given),),
            checked,
            f"shape {np.shape(share)}",
            f"({len(given)},)",
        )
        expect(share.dtype == np.float64, checked, f"dtype {share.dtype}", "float64")
        expect((share >= 0).all(), checked, share, "shares of at least 0")
        expect(
            not len(given) or abs(share.sum() - 1) < 1e-9,
            checked,
            f"a sum of {share.sum():.6g}",
            "shares that sum to 1",
        )
    expect(same(model.score(objects), make().score(objects)), "score by another instance", "another answer", "the same")


def check_matcher(make: Callable[[], GraphMatcher]) -> None:
    """A graph is found among others; pairs are one-to-one; nothing is answered to a query that shares nothing; a query
    may have bearings only."""
    matcher = make()
    sparse = replace(ROOMS[0], boxes=ROOMS[0].boxes[:-2])
    graphs = [*map(room_graph, (*ROOMS, sparse)), room_graph(sparse.emptied())]
    ask("index and match", lambda graphs: matcher.match(graphs[0], matcher.index(graphs), len(graphs)), graphs)
    index = matcher.index(graphs)
    for scene, query in enumerate(graphs[: len(ROOMS)]):
        checked = f"match of the {ROOMS[scene].name} among {len(graphs)} graphs"
        matches = ask(checked, lambda query: matcher.match(query, index, len(graphs)), query)
        _check_matches(checked, matches, query, graphs, len(graphs))
        expect(
            matches and matches[0].scene == scene,
            checked,
            [match.scene for match in matches],
            f"the same graph, {scene}, first",
        )
        _check_matches(f"{checked}, top_k = 1", attempt(checked, matcher.match, query, index, 1), query, graphs, 1)
    expect(
        same(matches, attempt("match", lambda other: other.match(query, other.index(graphs), len(graphs)), make())),
        f"{checked} by another instance",
        "another answer",
        "the same",
    )

    unranged = without_range(graphs[0])
    checked = "match of a graph without range"
    found = ask(checked, lambda query: matcher.match(query, index, len(graphs)), unranged)
    _check_matches(checked, found, unranged, graphs, len(graphs))

    alone = attempt("index of one graph", matcher.index, graphs[:1])
    found = attempt("match against one graph", matcher.match, graphs[0], alone, 5)
    _check_matches("match against one graph", found, graphs[0], graphs[:1], 5)
    strange = replace(graphs[0], labels=tuple(f"strange {label}" for label in graphs[0].labels))
    for what, query in (("a graph without objects", graphs[-1]), ("a graph whose labels the map lacks", strange)):
        matches = ask(f"match of {what}", lambda query: matcher.match(query, index, len(graphs)), query)
        expect(matches == [], f"match of {what}", f"{len(matches)} matches", "an empty list")


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
        f"different ones below {len(graphs)}",
    )
    expect(
        np.isfinite(scores).all() and scores == sorted(scores, reverse=True),
        checked,
        f"scores {scores}",
        "finite ones, best first",
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
            "a T_scene_query that is no rigid motion",
            "(4, 4) or None",
        )


def check_positioner(make: Callable[[], Positioner]) -> None:
    """Exact on points without noise, and on directions where it takes them; a status where there are too few points or
    all are one."""
    positioner = make()
    truth = pose_2d(1.2, -0.7, 2.1)
    reference_m = np.random.default_rng(0).uniform((-3, -3, -1), (3, 3, 1), (8, 3))
    query_m = transform_points(invert_pose(truth), reference_m)
    for weights in (None, np.linspace(0.5, 1.5, 8)):
        checked = "solve of 8 points without noise" + ("" if weights is None else ", weighted")
        estimate = ask(checked, positioner.solve, query_m, reference_m, weights)
        _check_estimate(checked, estimate, 8)
        expect(estimate.status is PoseStatus.OK, checked, f"the status '{estimate.status}'", "ok")
        shift_m, turn_rad = pose_errors(estimate.T_reference_query, truth)
        expect(
            max(shift_m, turn_rad) < 1e-6,
            checked,
            f"a pose {shift_m:.2g} m and {np.degrees(turn_rad):.2g} deg off",
            "the exact pose",
        )
    expect(
        same(estimate, make().solve(query_m, reference_m, weights)),
        "solve by another instance",
        "another answer",
        "the same",
    )

    bearing = query_m / np.linalg.norm(query_m, axis=1, keepdims=True)
    estimate = ask("resect 8 directions without noise", positioner.resect, bearing, reference_m)
    _check_estimate("resect 8 directions without noise", estimate, 8)
    if estimate.status is not PoseStatus.NO_RANGE:
        expect(estimate.status is PoseStatus.OK, "resect 8 directions", f"the status '{estimate.status}'", "ok")
        shift_m, turn_rad = pose_errors(estimate.T_reference_query, truth)
        off = f"a pose {shift_m:.2g} m and {np.degrees(turn_rad):.2g} deg off"
        expect(max(shift_m, turn_rad) < 1e-6, "resect 8 directions without noise", off, "the exact pose")

    one = np.tile(query_m[:1], (5, 1)), np.tile(reference_m[:1], (5, 1))
    failing = {
        "no point": (query_m[:0], reference_m[:0]),
        "one point": (query_m[:1], reference_m[:1]),
        "five times one point": one,
    }
    for what, (query, reference) in failing.items():
        estimate = ask(f"solve of {what}", positioner.solve, query, reference)
        _check_estimate(f"solve of {what}", estimate, len(query))
        expect(
            estimate.status is not PoseStatus.OK, f"solve of {what}", "a pose", "a status that says why there is none"
        )


def _check_estimate(checked: str, estimate: PoseEstimate, count: int) -> None:
    expect(isinstance(estimate, PoseEstimate), checked, type(estimate).__name__, "PoseEstimate")
    pose, covariance, inliers = estimate.T_reference_query, estimate.covariance, estimate.inliers
    expect(
        (pose is not None) == (estimate.status is PoseStatus.OK),
        checked,
        f"the status '{estimate.status}' with{'out' * (pose is None)} a pose",
        "a pose where the status is ok, and only there",
    )
    expect(pose is None or is_rigid(pose), checked, f"{pose}", "a rigid motion (4, 4)")
    is_mask = isinstance(inliers, np.ndarray) and inliers.dtype == bool and inliers.shape == (count,)
    expect(is_mask, checked, f"inliers of shape {np.shape(inliers)}", f"({count},) bool")
    fits = covariance is None or (covariance.shape in ((3, 3), (6, 6)) and np.allclose(covariance, covariance.T))
    expect(fits, checked, f"the covariance {covariance}", "a symmetric one, (3, 3) or (6, 6), or None")
    expect(0 <= estimate.runner_up <= 1, checked, f"runner_up {estimate.runner_up}", "from 0 to 1")


def check_planner(make: Callable[[], Planner]) -> None:
    """The shortest of two routes, its legs as they are walked, none to the start itself, and NoRoute to an island."""
    places = {
        "hall": (0.0, 0.0, 0.0),
        "door": (3.0, 0.0, 0.0),
        "room": (3.0, 4.0, 0.0),
        "yard": (-9.0, 0.0, 0.0),
        "island": (50.0, 0.0, 0.0),
    }
    nodes = tuple(MapNode(name, NodeKind.SCENE, xyz_m, (name,)) for name, xyz_m in places.items())
    walks = [("hall", "door"), ("door", "room"), ("hall", "yard"), ("yard", "room")]
    edges = tuple(_walk(places, *walk) for walk in walks)
    bend = ((3.0, 0.0), (3.0, 2.0), (3.0, 4.0))
    edges = tuple(replace(edge, path_m=bend) if (edge.start, edge.end) == ("door", "room") else edge for edge in edges)
    planner = make()
    ask("prepare", planner.prepare, TopologicalMap(nodes, edges))
    for start, goal, through in (
        ("hall", "room", ("hall", "door", "room")),
        ("room", "hall", ("room", "door", "hall")),
        ("hall", "hall", ("hall",)),
    ):
        checked = f"route from {start} to {goal}"
        route = ask(checked, planner.route, start, goal)
        expect(isinstance(route, Route), checked, type(route).__name__, "Route")
        expect(route.nodes == through, checked, f"{route.nodes}", f"the shortest, {through}")
        legs = [(leg.start, leg.end) for leg in route.legs]
        expect(legs == list(pairwise(through)), checked, f"the legs {legs}", "one from each node to the next")
        length_m = sum(_walk(places, *leg).length_m for leg in legs)
        expect(abs(route.length_m - length_m) < 1e-9, checked, f"a length of {route.length_m} m", f"{length_m} m")
        for leg in route.legs:
            off_rad = np.angle(np.exp(1j * (leg.azimuth_rad - _walk(places, leg.start, leg.end).azimuth_rad)))
            expect(
                abs(off_rad) < 1e-9,
                checked,
                f"azimuth {leg.azimuth_rad:.4f} from {leg.start} to {leg.end}",
                "that of the walking direction",
            )
            path_m = {("door", "room"): bend, ("room", "door"): bend[::-1]}.get((leg.start, leg.end), ())
            expect(
                leg.path_m == path_m,
                checked,
                f"the path {leg.path_m} from {leg.start} to {leg.end}",
                f"{path_m}, in the walking direction",
            )
    try:
        planner.route("hall", "island")
    except NoRoute:
        return
    expect(False, "route to a node without edges", "a route", "NoRoute")


def _walk(places: dict[str, tuple[float, float, float]], start: str, end: str) -> MapEdge:
    along = np.subtract(places[end], places[start])
    return MapEdge(start, end, float(np.linalg.norm(along)), float(np.arctan2(along[1], along[0])))
