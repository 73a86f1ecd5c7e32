"""Conformance rules for components of the role `localizer`."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.files.hashes import digest
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.describing import complete_panorama, required_parts
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_errors
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.turning import turned
from salframe.testing.configurations import differences, on_rooms, random_config
from salframe.testing.detectors import check_needs, turns
from salframe.testing.expectations import DoesNotApply, attempt, call_twice, expect, same
from salframe.testing.identities import check_identities
from salframe.testing.rooms import HEIGHT_PX, PARTS, blank_panorama, halved, map_frames, query_frames, random_frames
from salframe.testing.rules import Rules

SEEDS = (0, 1, 2)
"""Seeds of the random rooms. With seed 0 the localizer has the settings under test, with other seeds random ones."""
_MOVED = 1e-3
"""Tolerance of numbers after the world frame has moved, because other coordinates have other rounding errors."""
_ROUNDING = 1e-6
"""Tolerance of numbers. The order of sums in a network depends on the memory address of its input."""


class LocalizerRules(Rules[Localizer]):
    """Answers are well formed for any map and equal after saving and loading. Poses rotate with the panorama."""

    @cached_property
    def _frames(self) -> list[ReferenceFrame]:
        return map_frames()

    @cached_property
    def _map(self) -> LocalizationMap:
        """Map of the suite's rooms."""
        return _build(f"build of {len(self._frames)} frames", self.make(), self._frames)

    @property
    def _localizer(self) -> Localizer:
        return self._map.localizer

    @cached_property
    def _random_maps(self) -> list[_RandomMap]:
        """Maps of random rooms, one for each of SEEDS."""
        return [_random_map(self._localizer.config, seed) for seed in SEEDS]

    @cached_property
    def _answers(self) -> list[tuple[Panorama, Localization]]:
        """The queries, each with its answer."""
        queries = [frame.load() for frame in query_frames()]
        return [(query, _answer(self._map, f"of the {query.id}", query, self._frames)) for query in queries]

    def answers_are_well_formed(self) -> None:
        check_needs(self._localizer.needs)
        expect(self._answers, "match", "no answer", "an answer to each query")

    def describe_identity_is_stable(self) -> None:
        cache_key = attempt("describe_identity as JSON", lambda: digest(self._localizer.describe_identity()))
        other = digest(self.make().describe_identity())
        expect(other == cache_key, "describe_identity of another instance", "another identity", "the same identity")

    def identity_covers_the_settings(self) -> None:
        query, _ = self._answers[0]
        check_identities(
            self.make, lambda made: made.describe_identity(), lambda made: _describe(made, query), "describe_identity"
        )

    def poses_rotate_with_the_panorama(self) -> None:
        cases = [(self._map, "", self._answers)]
        cases += [(random.built, f" in {random}", random.panoramas()) for random in self._random_maps]
        cases = [case for case in cases if case[0].localizer.column_step is not None]
        if not cases:
            raise DoesNotApply(
                "column_step of the localizer is None, so the estimated heading need not follow a turn of the query "
                "exactly"
            )
        for built, where, answers in cases:
            steps = 3 * turns(cast(int, built.localizer.column_step))
            for (query, answer), columns in zip(answers, steps, strict=False):
                _check_turn(built, query, answer, columns, where)

    def the_order_and_names_of_frames_do_not_matter(self) -> None:
        for random in self._random_maps:
            rng = np.random.default_rng(random.seed)
            order = rng.permutation(len(random.frames)).tolist()
            names = {frame.id: f"frame {n}" for frame, n in zip(random.frames, rng.permutation(99), strict=False)}
            renamed = [replace(random.frames[i], id=names[random.frames[i].id]) for i in order]
            changed = random.index([random.descriptions[i] for i in order], renamed)
            random.check("permuted and renamed frames", changed)

    def poses_move_with_the_world(self) -> None:
        for random in self._random_maps:
            rng = np.random.default_rng(random.seed)
            x_m, y_m, yaw_rad = rng.uniform([-50, -50, -np.pi], [50, 50, np.pi]).tolist()
            world = pose_2d(x_m, y_m, yaw_rad)
            moved = [replace(frame, T_world_pano=world @ frame.T_world_pano) for frame in random.frames]
            random.check("a moved world", random.index(random.descriptions, moved), world)

    def a_grown_map_gives_the_same_answers(self) -> None:
        for random in self._random_maps:
            frames = random.frames
            grown = random.index(random.descriptions[:4], frames[:4])
            attempt("extend", grown.extend, frames[4:])
            random.check("a map that was extended", grown)

    def workers_give_the_same_answers(self) -> None:
        """Check answers of two instances, each built from the JSON of the settings as in a worker process of a run.

        The queries are divided among the instances, in reversed order and each query twice. No answer may depend on
        earlier queries. No processes are started, because this takes seconds, and a worker may be unable to import the
        component of a test.
        """
        for random in self._random_maps:
            for first in range(2):
                worker = random.index(random.descriptions, random.frames)
                for number in reversed(range(first, len(random.queries), 2)):
                    random.check_query("another worker", worker, number)
                    random.check_query("another worker, for the second time", worker, number)

    def sparse_input_raises_no_error(self) -> None:
        inputs = {"of a blank panorama": blank_panorama(PARTS), "of half a panorama": halved(self._answers[0][0])}
        for what, panorama in inputs.items():
            _answer(self._map, what, panorama, self._frames)

    def its_needs_suffice(self) -> None:
        parts = required_parts(self._localizer, frozenset())
        for frame in query_frames(parts)[:1]:
            what = f"of a panorama with {' and '.join(sorted(parts))} alone"
            _answer(self._map, what, frame.load(), self._frames)

    def a_saved_map_gives_the_same_answers(self) -> None:
        for random in self._random_maps:
            with tempfile.TemporaryDirectory() as directory:
                attempt("save", random.built.save, Path(directory) / "map")
                opened = attempt("open", LocalizationMap.open, Path(directory) / "map", random.make())
                random.check("a map that was saved and opened", opened)

    def small_maps_give_answers(self) -> None:
        """Check maps that are too small or empty to learn a vocabulary or to normalize scores."""
        blank = ReferenceFrame("blank", "nowhere", np.eye(4), load=lambda: blank_panorama(PARTS))
        first = self._frames[0]
        for what, frames in (
            ("one frame", [first]),
            ("a blank frame and another", [blank, first]),
            ("one blank frame", [blank]),
        ):
            small = _build(f"build of {what}", self.make(), frames)
            for query in (self._answers[0][0], blank_panorama(PARTS)):
                _answer(small, f"of the {query.id} in a map of {what}", query, frames)


@dataclass(frozen=True)
class _RandomMap:
    """A map of random rooms, with queries.

    Attributes:
        seed: Seed of the rooms.
        config: Settings of the localizer.
        drawn: The settings that were drawn, "key=value" separated by commas.
        frames: Reference frames.
        descriptions: Descriptions of `frames`.
        built: The map.
        queries: The panorama, the description and the answer of each query.
    """

    seed: int
    config: ComponentConfig
    drawn: str
    frames: list[ReferenceFrame]
    descriptions: list[Description]
    built: LocalizationMap
    queries: list[tuple[Panorama, Description, Localization]]

    def __str__(self) -> str:
        return f"the random rooms of seed {self.seed}" + (
            f" with the random settings {self.drawn}" if self.drawn else ""
        )

    def make(self) -> Localizer:
        """Return a new localizer with these settings."""
        return _make(self.config)

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> LocalizationMap:
        """Return the map that a new localizer makes of frames and their descriptions."""
        return _index(self.make(), descriptions, frames)

    def panoramas(self) -> list[tuple[Panorama, Localization]]:
        """Return the queries with their answers."""
        return [(panorama, answer) for panorama, _, answer in self.queries]

    def check(self, changed: str, other: LocalizationMap, world: np.ndarray | None = None) -> None:
        """Check that another map gives the same answers. With `world`, all poses must have moved by this transform."""
        for number in range(len(self.queries)):
            self.check_query(changed, other, number, world)

    def check_query(self, changed: str, other: LocalizationMap, number: int, world: np.ndarray | None = None) -> None:
        """Check that another map gives the same answer to a query. With `world`, its pose must have moved by this
        transform."""
        _, description, before = self.queries[number]
        checked = f"match of query {number} in {self}, with {changed}"
        _expect_same(checked, before, attempt(checked, other.answer, description), world)


def _random_map(config: ComponentConfig, seed: int) -> _RandomMap:
    """Return a map of the random rooms of a seed. The settings are `config` for seed 0, and random for other seeds."""
    used_config = random_config(config, seed) if seed else config
    frames, query_frames = random_frames(seed)
    localizer, drawn = _make(used_config), differences(config, used_config)
    what = f"of random rooms with the random settings {drawn}" if drawn else "of random rooms"
    descriptions = [_describe(localizer, frame.load()) for frame in frames]
    built = _index(localizer, descriptions, frames)
    queries = []
    for panorama in (query.load() for query in query_frames):
        description = attempt(f"describe {what}", _describe, localizer, panorama)
        queries.append((panorama, description, attempt(f"match {what}", built.answer, description)))
    return _RandomMap(seed, used_config, drawn, frames, descriptions, built, queries)


def _make(config: ComponentConfig) -> Localizer:
    """Return a new localizer, built from the JSON of its settings as in a worker process of a run."""
    localizer: Localizer = attempt("creation of the component", config.component, on_rooms(config))
    return localizer


def _index(
    localizer: Localizer, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]
) -> LocalizationMap:
    built: LocalizationMap = attempt(
        "index of random rooms", LocalizationMap.from_descriptions, localizer, descriptions, frames
    )
    return built


def _expect_same(checked: str, before: Localization, after: Localization, world: np.ndarray | None = None) -> None:
    """Check that two answers are equal. With `world`, the pose must have moved by this transform."""
    expect(after.status == before.status, checked, f"the status '{after.status}'", f"'{before.status}' as before")
    tolerance = _ROUNDING if world is None else _MOVED
    fields = ("out_of_map_probability", *(("covariance",) if world is None else ()))
    for field in fields:
        values_of = getattr(before, field), getattr(after, field)
        expect(same(*values_of, tolerance), checked, f"{field} {values_of[1]}", f"{values_of[0]} as before")
    values = [
        {ranked.place: (ranked.score, ranked.probability) for ranked in answer.places} for answer in (before, after)
    ]
    is_same = values[0].keys() == values[1].keys() and all(
        same(values[0][place], values[1][place], tolerance) for place in values[0]
    )
    expect(is_same, checked, f"the places {values[1]}", f"{values[0]} as before")
    first = [[ranked.place for ranked in answer.places[:1]] for answer in (before, after)]
    expect(first[0] == first[1], checked, f"the best place {first[1]}", f"{first[0]} as before")
    if before.T_world_query is not None and after.T_world_query is not None:
        expected = before.T_world_query if world is None else world @ before.T_world_query
        shift_m, turn_rad = pose_errors(after.T_world_query, expected)
        expect(
            max(shift_m, turn_rad) <= tolerance,
            checked,
            f"a pose that is {shift_m:.2g} m and {turn_rad:.2g} rad off",
            f"at most {tolerance:g} of each",
        )


def _build(checked: str, localizer: Localizer, frames: Sequence[ReferenceFrame]) -> LocalizationMap:
    built: LocalizationMap = attempt(checked, LocalizationMap.build, localizer, frames)
    return built


def _describe(localizer: Localizer, panorama: Panorama) -> Description:
    """Describe a panorama. A localizer with a range model estimates the range if the panorama has none."""
    return localizer.describe(complete_panorama(localizer, panorama)[0])


def _answer(
    reference_map: LocalizationMap, what: str, panorama: Panorama, frames: Sequence[ReferenceFrame]
) -> Localization:
    """Describe and match a panorama, and check the description and the answer."""
    description: Description = call_twice(
        f"describe {what}", lambda query: _describe(reference_map.localizer, query), panorama
    )
    arrays = all(isinstance(array, np.ndarray) and array.dtype != object for array in description.values())
    expect(
        arrays,
        f"describe {what}",
        {name: type(part).__name__ for name, part in description.items()},
        "arrays, none of them of dtype object",
    )
    answer, checked = call_twice(f"match {what}", reference_map.answer, description), f"match {what}"
    places, scores = [ranked.place for ranked in answer.places], [ranked.score for ranked in answer.places]
    expect(len(set(places)) == len(places), checked, f"the places {places}", "one entry per place")
    references = {(frame.id, frame.place) for frame in frames}
    unknown = [ranked for ranked in answer.places if (ranked.frame, ranked.place) not in references]
    expect(not unknown, checked, unknown, "reference frames with their places")
    expect(
        np.isfinite(scores).all() and scores == sorted(scores, reverse=True),
        checked,
        f"scores {scores}",
        "finite scores, best first",
    )
    # Localization itself checks that all places have a probability and that the sum with out_of_map_probability is 1.
    probabilities = [ranked.probability for ranked in answer.places if ranked.probability is not None]
    ordered = probabilities == sorted(probabilities, reverse=True)
    expect(ordered, checked, f"the probabilities {probabilities}", "descending probabilities")
    pose = answer.T_world_query
    expect(
        (pose is not None) == (answer.status is LocalizationStatus.OK),
        checked,
        f"the status '{answer.status}' with{'out' * (pose is None)} a pose",
        "a pose if and only if the status is ok",
    )
    return answer


def _check_turn(
    reference_map: LocalizationMap, panorama: Panorama, before: Localization, columns: int, where: str
) -> None:
    """Check that the rotated panorama gives the same place, and a pose that differs by the rotation only."""
    localizer = reference_map.localizer
    checked, tolerance = f"match of the {panorama.id} rolled by {columns} columns{where}", localizer.turn_tolerance_m
    after = attempt(checked, lambda: reference_map.answer(_describe(localizer, turned(panorama, columns))))
    hint = f"or a column_step that is a larger multiple of {localizer.column_step}"
    expect(
        after.status == before.status, checked, f"the status '{after.status}'", f"'{before.status}' as before, {hint}"
    )
    places = [[ranked.place for ranked in answer.places[:1]] for answer in (before, after)]
    expect(places[0] == places[1], checked, f"the place {places[1]}", f"{places[0]} as before, {hint}")
    if before.T_world_query is not None:
        expected = before.T_world_query @ pose_2d(0, 0, np.pi * columns / HEIGHT_PX)
        shift_m, turn_rad = pose_errors(after.T_world_query, expected)
        expect(
            max(shift_m, turn_rad) <= tolerance,
            checked,
            f"a pose that moved {shift_m:.2g} m and is {turn_rad:.2g} rad off the rotation",
            f"at most turn_tolerance_m = {tolerance:g} of each",
        )
