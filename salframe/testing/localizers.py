"""The rules of the role `localizer`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from salframe.framework.identity import digest
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.frames import MapFrame
from salframe.panoramas.geometry import pose_2d, pose_errors
from salframe.panoramas.panorama import Panorama
from salframe.testing.asking import ask, attempt, expect, same
from salframe.testing.detectors import turns
from salframe.testing.identities import check_identities
from salframe.testing.rooms import HEIGHT_PX, PARTS, blind, halved, map_frames, query_frames, turned


def check_localizer(make: Callable[[], Localizer]) -> None:
    """Well-formed answers from any map, the same after saving and loading, and a pose that turns with the panorama."""
    localizer, frames = make(), map_frames()
    expect(
        localizer.needs and localizer.needs <= PARTS,
        "needs",
        set(localizer.needs),
        f"some of {', '.join(sorted(PARTS))}",
    )
    known_by = attempt("describe_identity as JSON", lambda: digest(localizer.describe_identity()))
    expect(
        digest(make().describe_identity()) == known_by,
        "describe_identity of another instance",
        "another one",
        "the same",
    )
    attempt(f"build of {len(frames)} frames", localizer.build, frames)

    queries = [frame.load() for frame in query_frames()]
    check_identities(
        make, lambda one: one.describe_identity(), lambda one: _describe(one, queries[0]), "describe_identity"
    )
    answers = [_answer(localizer, f"of the {query.id}", query, frames) for query in queries]
    for query, answer, columns in zip(queries, answers, 3 * turns(localizer.column_step), strict=False):
        _check_turn(localizer, query, answer, columns)
    odd = {"where nothing is seen": blind(PARTS), "of half a panorama": halved(queries[0])}
    for what, panorama in odd.items():
        _answer(localizer, what, panorama, frames)
    _check_needs(localizer)
    _check_saving(localizer, make, queries, answers)

    # What a vocabulary is learnt from, or a score divided by, may be missing altogether.
    nothing = MapFrame("nothing", "nowhere", np.eye(4), load=lambda: blind(PARTS))
    for what, few in (
        ("one frame", frames[:1]),
        ("a frame where nothing is seen, and another", [nothing, frames[0]]),
        ("one frame where nothing is seen", [nothing]),
    ):
        small = make()
        attempt(f"build of {what}", small.build, few)
        for query in (queries[0], odd["where nothing is seen"]):
            _answer(small, f"of the {query.id} in a map of {what}", query, few)


def _describe(localizer: Localizer, panorama: Panorama) -> Description:
    """The description of a panorama that is given its range where the localizer has a range model for it."""
    return localizer.describe(localizer.complete(panorama)[0])


def _answer(localizer: Localizer, what: str, panorama: Panorama, frames: Sequence[MapFrame]) -> Localization:
    """Describe and match, with every rule on the description and the answer checked."""
    description: Description = ask(f"describe {what}", lambda seen: _describe(localizer, seen), panorama)
    arrays = all(isinstance(array, np.ndarray) and array.dtype != object for array in description.values())
    expect(
        arrays,
        f"describe {what}",
        {name: type(part).__name__ for name, part in description.items()},
        "arrays, none of dtype object",
    )
    answer, checked = ask(f"match {what}", localizer.answer, description), f"match {what}"
    expect(isinstance(answer, Localization), checked, type(answer).__name__, "Localization")
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
    # That there is one for each place and that they and `not_here` are one together was checked when they were made.
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


def _check_turn(localizer: Localizer, panorama: Panorama, before: Localization, columns: int) -> None:
    """The same place, and a pose that differs by the turn alone."""
    checked, tolerance = f"match of the {panorama.id} rolled by {columns} columns", localizer.turn_tolerance_m
    after = attempt(checked, lambda: localizer.answer(_describe(localizer, turned(panorama, columns))))
    expect(after.status == before.status, checked, f"the status '{after.status}'", f"'{before.status}' as before")
    places = [[ranked.place for ranked in answer.places[:1]] for answer in (before, after)]
    expect(places[0] == places[1], checked, f"the place {places[1]}", f"{places[0]} as before")
    if before.T_world_query is not None:
        expected = before.T_world_query @ pose_2d(0, 0, np.pi * columns / HEIGHT_PX)
        shift_m, turn_rad = pose_errors(after.T_world_query, expected)
        expect(
            max(shift_m, turn_rad) <= tolerance,
            checked,
            f"a pose that moved {shift_m:.2g} m and is {turn_rad:.2g} rad off the turn",
            f"at most turn_tolerance_m = {tolerance:g} of each",
        )


def _check_needs(localizer: Localizer) -> None:
    """What `needs` says is enough: the other parts may be missing."""
    parts = localizer.needs_of(frozenset())
    for frame in query_frames(parts)[:1]:
        _answer(localizer, f"of a panorama with {' and '.join(sorted(parts))} alone", frame.load(), map_frames())


def _check_saving(
    localizer: Localizer, make: Callable[[], Localizer], queries: Sequence[Panorama], answers: Sequence[Localization]
) -> None:
    """A fresh instance that loads the map answers as the one that saved it."""
    with tempfile.TemporaryDirectory() as directory:
        attempt("save", localizer.save, Path(directory) / "map")
        loaded = make()
        attempt("load", loaded.load, Path(directory) / "map")
        for query, answer in zip(queries, answers, strict=True):
            checked = f"match of the {query.id} after save and load"
            again = attempt(checked, lambda query: loaded.answer(_describe(loaded, query)), query)
            for field in ("status", "places", "T_world_query", "covariance", "not_here"):
                before, after = getattr(answer, field), getattr(again, field)
                expect(same(before, after), checked, f"{field} {after}", f"{before} as before")
