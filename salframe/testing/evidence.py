"""Rules of the role `evidence`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from salframe.framework.components.defaults import default_of
from salframe.framework.components.presets import configure, settings
from salframe.framework.config import merge
from salframe.localization.evidence_model import EvidenceColumn, EvidenceModel
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.panorama import Panorama
from salframe.testing.configurations import on_rooms
from salframe.testing.expectations import ConformanceError, ask, attempt, expect, same
from salframe.testing.localizers import LocalizerRules
from salframe.testing.rooms import PARTS, blind, query_frames
from salframe.testing.rules import Rules, RuleStatus, check_all

_NAME = re.compile(r"[a-z][a-z0-9_]*")


class EvidenceRules(Rules[EvidenceModel]):
    """Columns and stored arrays are declared, and arrays are the same after packing. The default method with this
    evidence alone keeps the rules of localizers: `score` returns finite columns, a saved map gives the same answers."""

    @cached_property
    def _localizer(self) -> Localizer:
        """The default method with this evidence alone. A column without a weight has the weight 1."""
        model, method = self.make(), default_of("map_method")
        weights = {name: 1.0 for name, column in model.columns.items() if column.weight is None}
        changes = {"detector": "annotations", "evidence": [model.config.model_dump(mode="json")], "weights": weights}
        config = on_rooms(configure(Localizer.role, method, merge(settings(Localizer.role, method), changes)))
        localizer: Localizer = config.component(config)
        return localizer

    def columns_are_declared(self) -> None:
        columns = self.make().columns
        expect(isinstance(columns, Mapping) and columns, "columns", columns, "a mapping from names to EvidenceColumn")
        for name, column in columns.items():
            checked = f"column {name!r}"
            is_name = isinstance(name, str) and _NAME.fullmatch(name)
            expect(is_name, checked, name, "a name of lower-case letters, digits and underscores")
            expect(isinstance(column, EvidenceColumn), checked, type(column).__name__, "EvidenceColumn")
            expect(column.description.strip(), checked, "no description", "what the numbers are, with their unit")
            expect(
                column.weight is None or np.isfinite(column.weight), checked, f"weight {column.weight}", "a finite one"
            )

    def described_arrays_are_declared(self) -> None:
        for what, panorama in self._panoramas():
            self._arrays(what, panorama)

    def packing_is_stable(self) -> None:
        model = self.make()
        for what, panorama in self._panoramas():
            arrays = self._arrays(what, panorama)
            packed = ask(f"pack {what}", model.pack, {**self._base(panorama), **arrays})
            unpacked = ask(f"unpack {what}", model.unpack, packed)
            expect(
                unpacked.keys() == arrays.keys(),
                f"unpack {what}",
                f"the arrays {sorted(unpacked)}",
                f"those of describe: {sorted(arrays)}",
            )
            again = attempt(f"pack {what} after unpacking", model.pack, unpacked)
            expect(same(again, packed), f"pack {what} after unpacking", "other arrays", "the same arrays")

    def the_default_method_with_it_keeps_the_rules_of_localizers(self) -> None:
        config = self._localizer.config
        for result in check_all(LocalizerRules(lambda: config.component(config)).list()):
            if result.status is RuleStatus.FAILED:
                raise ConformanceError(f"with this evidence alone, {result.rule}: {result.message}")

    def _panoramas(self) -> Sequence[tuple[str, Panorama]]:
        """Return a query of the suite, whole and without each part that the evidence uses, and a blank panorama."""
        query = query_frames()[0].load()
        names = {"rgb": "rgb", "range": "range_m", "annotations": "annotations"}
        without = [
            (f"a panorama without {part}", replace(query, **{names[part]: None})) for part in sorted(self.make().uses)
        ]
        return [(f"the {query.id}", query), *without, ("a blank panorama", blind(PARTS))]

    def _base(self, panorama: Panorama) -> Description:
        """Return the description of a panorama without this evidence."""
        if panorama.annotations is None:
            return {}
        described = attempt("describe by the default method", self._localizer.describe, panorama)
        return {name: array for name, array in described.items() if name not in self.make().arrays}

    def _arrays(self, what: str, panorama: Panorama) -> Description:
        checked, model = f"describe {what}", self.make()
        arrays: Description = ask(checked, model.describe, panorama, self._base(panorama))
        undeclared = sorted(set(arrays) - set(model.arrays))
        expect(not undeclared, checked, f"the arrays {undeclared}", f"only those of `arrays`: {list(model.arrays)}")
        are_arrays = all(isinstance(array, np.ndarray) and array.dtype != object for array in arrays.values())
        expect(are_arrays, checked, {name: type(array).__name__ for name, array in arrays.items()}, "arrays of numbers")
        return arrays
