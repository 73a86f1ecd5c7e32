"""The rules of the role `localizer`."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from salframe.framework.files.hashes import digest
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.describing import complete_panorama, required_parts
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_errors
from salframe.panoramas.panorama import Panorama
from salframe.testing.asking import ask, attempt, expect, same
from salframe.testing.detectors import check_needs, turns
from salframe.testing.identities import check_identities
from salframe.testing.rooms import HEIGHT_PX, PARTS, blind, halved, map_frames, query_frames, turned
from salframe.testing.rules import Rules

_ROUNDING = 1e-6
"""Networks sum in an order that depends on where their input lies in memory."""


class LocalizerRules(Rules[Localizer]):
    """Well-formed answers from any map, the same after saving and loading, and a pose that turns with the panorama."""

    @cached_property
    def _frames(self) -> list[ReferenceFrame]:
        return map_frames()

    @cached_property
    def _map(self) -> LocalizationMap:
        """The map of the suite's rooms."""
        return _build(f"build of {len(self._frames)} frames", self.make(), self._frames)

    @property
    def _localizer(self) -> Localizer:
        return self._map.localizer

    @cached_property
    def _answers(self) -> list[tuple[Panorama, Localization]]:
        """Queries, and what is answered to them."""
        queries = [frame.load() for frame in query_frames()]
        return [(query, _answer(self._map, f"of the {query.id}", query, self._frames)) for query in queries]

    def answers_are_well_formed(self) -> None:
        check_needs(self._localizer.needs)
        expect(self._answers, "match", "no answer", "an answer to each query")

    def it_is_known_by_its_settings(self) -> None:
        cache_key = attempt("describe_identity as JSON", lambda: digest(self._localizer.describe_identity()))
        other = digest(self.make().describe_identity())
        expect(other == cache_key, "describe_identity of another instance", "another one", "the same")

    def settings_change_what_they_may(self) -> None:
        query, _ = self._answers[0]
        check_identities(
            self.make, lambda one: one.describe_identity(), lambda one: _describe(one, query), "describe_identity"
        )

    def poses_turn_with_the_panorama(self) -> None:
        steps = 3 * turns(self._localizer.column_step)
        for (query, answer), columns in zip(self._answers, steps, strict=False):
            _check_turn(self._map, query, answer, columns)

    def little_to_see_is_no_error(self) -> None:
        odd = {"where nothing is seen": blind(PARTS), "of half a panorama": halved(self._answers[0][0])}
        for what, panorama in odd.items():
            _answer(self._map, what, panorama, self._frames)

    def its_needs_are_enough(self) -> None:
        parts = required_parts(self._localizer, frozenset())
        for frame in query_frames(parts)[:1]:
            what = f"of a panorama with {' and '.join(sorted(parts))} alone"
            _answer(self._map, what, frame.load(), self._frames)

    def a_saved_map_answers_the_same(self) -> None:
        with tempfile.TemporaryDirectory() as directory:
            attempt("save", self._map.save, Path(directory) / "map")
            opened = attempt("open", LocalizationMap.open, Path(directory) / "map", self.make())
            for query, answer in self._answers:
                checked = f"match of the {query.id} after save and open"
                again = attempt(checked, lambda query: opened.answer(_describe(opened.localizer, query)), query)
                for field in ("status", "places", "T_world_query", "covariance", "out_of_map_probability"):
                    before, after = getattr(answer, field), getattr(again, field)
                    expect(same(before, after, _ROUNDING), checked, f"{field} {after}", f"{before} as before")

    def small_maps_answer(self) -> None:
        """What a vocabulary is learnt from, or a score divided by, may be missing altogether."""
        nothing = ReferenceFrame("nothing", "nowhere", np.eye(4), load=lambda: blind(PARTS))
        first = self._frames[0]
        for what, few in (
            ("one frame", [first]),
            ("a frame where nothing is seen, and another", [nothing, first]),
            ("one frame where nothing is seen", [nothing]),
        ):
            small = _build(f"build of {what}", self.make(), few)
            for query in (self._answers[0][0], blind(PARTS)):
                _answer(small, f"of the {query.id} in a map of {what}", query, few)


def _build(checked: str, localizer: Localizer, frames: Sequence[ReferenceFrame]) -> LocalizationMap:
    built: LocalizationMap = attempt(checked, LocalizationMap.build, localizer, frames)
    return built


def _describe(localizer: Localizer, panorama: Panorama) -> Description:
    """Describe a panorama, with estimated range where it has none and the localizer has a range model."""
    return localizer.describe(complete_panorama(localizer, panorama)[0])


def _answer(known: LocalizationMap, what: str, panorama: Panorama, frames: Sequence[ReferenceFrame]) -> Localization:
    """Describe and match, with every rule on the description and the answer checked."""
    description: Description = ask(f"describe {what}", lambda seen: _describe(known.localizer, seen), panorama)
    arrays = all(isinstance(array, np.ndarray) and array.dtype != object for array in description.values())
    expect(
        arrays,
        f"describe {what}",
        {name: type(part).__name__ for name, part in description.items()},
        "arrays, none of dtype object",
    )
    answer, checked = ask(f"match {what}", known.answer, description), f"match {what}"
    places, scores = [ranked.place for ranked in answer.places], [ranked.score for ranked in answer.places]
    expect(len(set(places)) == len(places), checked, f"the places {places}", "one entry a place")
    belongs = {(frame.id, frame.place) for frame in frames}
    strange = [ranked for ranked in answer.places if (ranked.frame, ranked.place) not in belongs]
    expect(not strange, checked, strange, "frames of the map with their places")
    expect(
        np.isfinite(scores).all() and scores == sorted(scores, reverse=True),
        checked,
        f"scores {scores}",
        "finite ones, best first",
    )
    # That there is one for each place and that they and `out_of_map_probability` are one together was checked when they were made.
    shares = [ranked.probability for ranked in answer.places if ranked.probability is not None]
    expect(shares == sorted(shares, reverse=True), checked, f"the probabilities {shares}", "the best place's first")
    pose = answer.T_world_query
    expect(
        (pose is not None) == (answer.status is LocalizationStatus.OK),
        checked,
        f"the status '{answer.status}' with{'out' * (pose is None)} a pose",
        "a pose where the status is ok, and only there",
    )
    return answer


def _check_turn(known: LocalizationMap, panorama: Panorama, before: Localization, columns: int) -> None:
    """The same place, and a pose that differs by the turn alone."""
    localizer = known.localizer
    checked, tolerance = f"match of the {panorama.id} rolled by {columns} columns", localizer.turn_tolerance_m
    after = attempt(checked, lambda: known.answer(_describe(localizer, turned(panorama, columns))))
    mends = f"or column_step a multiple of its {localizer.column_step}"
    expect(
        after.status == before.status, checked, f"the status '{after.status}'", f"'{before.status}' as before, {mends}"
    )
    places = [[ranked.place for ranked in answer.places[:1]] for answer in (before, after)]
    expect(places[0] == places[1], checked, f"the place {places[1]}", f"{places[0]} as before, {mends}")
    if before.T_world_query is not None:
        expected = before.T_world_query @ pose_2d(0, 0, np.pi * columns / HEIGHT_PX)
        shift_m, turn_rad = pose_errors(after.T_world_query, expected)
        expect(
            max(shift_m, turn_rad) <= tolerance,
            checked,
            f"a pose that moved {shift_m:.2g} m and is {turn_rad:.2g} rad off the turn",
            f"at most turn_tolerance_m = {tolerance:g} of each",
        )
