"""Conformance rules for components of the role `evidence`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.localization.evidence_model import EvidenceColumn, EvidenceModel
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.panorama import Panorama
from salframe.testing.configurations import on_rooms
from salframe.testing.expectations import ConformanceError, DoesNotApply, attempt, call_twice, expect, same
from salframe.testing.localizers import LocalizerRules
from salframe.testing.rooms import PARTS, blank_panorama, query_frames
from salframe.testing.rules import Rules, RuleStatus, check_all

_NAME = re.compile(r"[a-z][a-z0-9_]*")


class EvidenceRules(Rules[EvidenceModel]):
    """Columns and stored arrays are declared, and arrays are the same after packing. A localizer with this evidence
    alone keeps the rules of localizers: `score` returns finite columns, and a saved map gives the same answers."""

    @cached_property
    def _localizer(self) -> Localizer:
        """The first localizer with the setting `evidence`, with this evidence alone. A column without a weight has the
        weight 1."""
        model = self.make()
        expect(
            model.name in registry().names(model.role),
            f"evidence {model.name!r}",
            "no registered evidence of this name",
            "one that a plugin provides (`salframe_provides`)",
        )
        users = [
            component
            for component, _ in registry()
            if component.role == Localizer.role and "evidence" in component.Config.model_fields
        ]
        if not users:
            raise DoesNotApply("no localizer with the setting `evidence` is installed")
        weights = {column.name: 1.0 for column in model.columns if column.weight is None}
        changes = {"detector": "annotations", "evidence": [model.config.model_dump(mode="json")], "weights": weights}
        config = on_rooms(configure(Localizer.role, users[0].name, changes))
        localizer: Localizer = users[0](config)  # type: ignore[assignment]
        return localizer

    def columns_are_declared(self) -> None:
        columns = self.make().columns
        are_columns = isinstance(columns, tuple) and all(isinstance(column, EvidenceColumn) for column in columns)
        expect(columns and are_columns, "columns", columns, "a tuple of at least one EvidenceColumn")
        names = [column.name for column in columns]
        expect(len(set(names)) == len(names), "columns", f"the names {names}", "different names")
        for column in columns:
            checked = f"column {column.name!r}"
            is_name = _NAME.fullmatch(column.name)
            expect(is_name, checked, column.name, "a name of lower-case letters, digits and underscores")
            expect(column.description.strip(), checked, "no description", "the meaning of the numbers, with their unit")
            expect(
                column.weight is None or np.isfinite(column.weight), checked, f"weight {column.weight}", "a finite one"
            )

    def packing_is_stable(self) -> None:
        model = self.make()
        for what, panorama in self._panoramas():
            arrays = self._arrays(what, panorama)
            packed = call_twice(f"pack {what}", model.pack, {**self._base(panorama), **arrays})
            unpacked = call_twice(f"unpack {what}", model.unpack, packed)
            expect(
                unpacked.keys() == arrays.keys(),
                f"unpack {what}",
                f"the arrays {sorted(unpacked)}",
                f"those of describe: {sorted(arrays)}",
            )
            again = attempt(f"pack {what} after unpacking", model.pack, unpacked)
            expect(same(again, packed), f"pack {what} after unpacking", "other arrays", "the same arrays")

    def a_localizer_with_it_keeps_the_rules_of_localizers(self) -> None:
        config = self._localizer.config
        for result in check_all(LocalizerRules(lambda: config.component(config)).list()):
            if result.status is RuleStatus.FAILED:
                raise ConformanceError(
                    f"the localizer with evidence=[{self.make().name}] fails the check {result.rule}: {result.message}"
                )

    def _panoramas(self) -> Sequence[tuple[str, Panorama]]:
        """Return named panoramas: a query of the suite, a blank panorama, and the query without each part that the
        evidence uses."""
        query = query_frames()[0].load()
        rest = [(f"a panorama without {part}", PARTS - {part}) for part in sorted(self.make().uses)]
        without = [(what, query_frames(parts)[0].load()) for what, parts in rest]
        return [(f"the {query.id}", query), *without, ("a blank panorama", blank_panorama(PARTS))]

    def _base(self, panorama: Panorama) -> Description:
        """Return the description of a panorama without this evidence."""
        if panorama.annotations is None:
            return {}
        described = attempt("describe by the localizer", self._localizer.describe, panorama)
        return {name: array for name, array in described.items() if name not in self.make().arrays}

    def _arrays(self, what: str, panorama: Panorama) -> Description:
        checked, model = f"describe {what}", self.make()
        arrays: Description = call_twice(checked, model.describe, panorama, self._base(panorama))
        are_arrays = all(isinstance(array, np.ndarray) and array.dtype != object for array in arrays.values())
        expect(are_arrays, checked, {name: type(array).__name__ for name, array in arrays.items()}, "arrays of numbers")
        return arrays
