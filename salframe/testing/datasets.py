"""Conformance rules for components of the role `dataset`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import cached_property

from salframe.framework.errors import SalframeError
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import is_rigid
from salframe.panoramas.panorama import Panorama
from salframe.testing.expectations import DoesNotApply, attempt, expect, same
from salframe.testing.rooms import PARTS
from salframe.testing.rules import Rules


class DatasetRules(Rules[Dataset]):
    """Folds hold reference frames with poses and queries without poses. Every query has a truth, and every panorama has
    the parts that `provides` names."""

    @cached_property
    def _dataset(self) -> Dataset:
        dataset = self.make()
        attempt("prepare", dataset.prepare, lambda done, total: None)
        return dataset

    @cached_property
    def _folds(self) -> Sequence[Fold]:
        return attempt("folds", self._dataset.folds)

    def it_has_folds(self) -> None:
        expect(len(self._folds), "folds", "none", "at least one")
        ids = [fold.id for fold in self._folds]
        expect(len(set(ids)) == len(ids), "folds", f"ids {ids}", "unique ids")

    def provides_is_available_before_prepare(self) -> None:
        dataset = self.make()
        before = attempt("provides before prepare", lambda: dataset.provides)
        expect(before and before <= PARTS, "provides", set(before), f"one or more of {', '.join(sorted(PARTS))}")
        provided = self._dataset.provides
        expect(provided == before, "provides after prepare", set(provided), f"{set(before)} as before prepare")

    def the_fingerprint_is_stable(self) -> None:
        fingerprint = attempt("fingerprint", lambda: self._dataset.fingerprint)
        expect(
            isinstance(fingerprint, str) and fingerprint, "fingerprint", repr(fingerprint), "a string that is not empty"
        )
        other = attempt("fingerprint of another instance", lambda: self.make().fingerprint)
        expect(
            other == fingerprint, "fingerprint of another instance", other, f"{fingerprint}, that of the first instance"
        )

    def queries_carry_no_truth(self) -> None:
        for fold in self._folds:
            _check_fold(self._dataset, fold)

    def panoramas_have_the_provided_parts(self) -> None:
        for fold in (self._folds[0], self._folds[-1]):
            for reference in fold.references[:1]:
                _check_panorama(self._dataset, reference)
            for query in fold.queries[:1]:
                _check_panorama(self._dataset, query)

    def an_unknown_query_has_no_truth(self) -> None:
        checked = "truth of an unknown query"
        try:
            self._dataset.truth("no such query")
        except SalframeError:
            return
        except Exception as error:
            expect(False, checked, repr(error), "DataError")
        expect(False, checked, "an answer", "DataError")

    def masks_of_a_floor_have_one_shape(self) -> None:
        floors: Sequence[FloorMasks] = attempt("floors", self._dataset.floors)
        if not floors:
            raise DoesNotApply("the dataset has no floor masks")
        for floor in floors:
            shapes = [mask.shape for mask in (floor.free, floor.region, floor.obstacle)]
            expect(len(set(shapes)) == 1, "floors", f"masks of shapes {shapes}", "one shape")


def _check_fold(dataset: Dataset, fold: Fold) -> None:
    checked = f"fold {fold.id}"
    expect(
        fold.references and fold.queries,
        checked,
        f"{len(fold.references)} reference frames and {len(fold.queries)} queries",
        "at least one of each",
    )
    ids = [*(frame.id for frame in fold.references), *(frame.id for frame in fold.queries)]
    repeated = [id for id, count in Counter(ids).items() if count > 1]
    expect(not repeated, checked, f"the repeated frame ids {', '.join(repeated)}", "a unique id for each frame")
    for frame in fold.references:
        expect(isinstance(frame, ReferenceFrame), f"reference frame {frame.id}", type(frame).__name__, "ReferenceFrame")
        expect(
            frame.place and is_rigid(frame.T_world_pano),
            f"reference frame {frame.id}",
            f"place {frame.place!r} and pose {frame.T_world_pano}",
            "a place and a rigid motion of shape (4, 4)",
        )
    for query in fold.queries:
        kind = type(query).__name__
        expect(
            type(query) is QueryFrame, f"query frame {query.id}", kind, "QueryFrame, which holds no pose and no place"
        )
        truth = attempt(f"truth of {query.id}", dataset.truth, query.id)
        expect(isinstance(truth, Truth) and truth.place, f"truth of {query.id}", truth, "a Truth with a place")
        expect(
            truth.T_world_pano is None or is_rigid(truth.T_world_pano),
            f"truth of {query.id}",
            f"pose {truth.T_world_pano}",
            "a rigid motion of shape (4, 4) or None",
        )


def _check_panorama(dataset: Dataset, frame: ReferenceFrame | QueryFrame) -> None:
    checked = f"load of {frame.id}"
    panorama = attempt(checked, frame.load)
    expect(isinstance(panorama, Panorama), checked, type(panorama).__name__, "Panorama")
    expect(panorama.id == frame.id, checked, f"a panorama with id {panorama.id!r}", f"id {frame.id!r}")
    expect(
        panorama.provides >= dataset.provides,
        checked,
        set(panorama.provides),
        f"all parts that the dataset provides, {set(dataset.provides)}",
    )
    expect(
        same(panorama, attempt(checked, frame.load)),
        f"{checked} twice",
        "two different panoramas",
        "the same panorama twice",
    )
