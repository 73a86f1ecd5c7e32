"""Evidence for the tests: one component that keeps the rules, and some that break one each."""

from __future__ import annotations

import numpy as np

import salframe


class Paint(salframe.EvidenceModel):
    """Similarity of the mean colours of query and place, and a column of zeros without a weight."""

    name = "paint"
    version = "1"
    columns = (salframe.EvidenceColumn("paint", "difference (0 to 1)", 4.0), salframe.EvidenceColumn("zero", "zero"))
    arrays = ("paint",)
    uses = frozenset({"rgb"})

    def describe(self, panorama, description):
        return {} if panorama.rgb is None else {"paint": panorama.rgb.mean((0, 1)) / 255}

    def index(self, descriptions, places, T_world_pano):
        self.places = places
        self.paints = np.stack([description.get("paint", np.ones(3)) for description in descriptions])

    def score(self, description, hypotheses):
        zero = np.zeros(len(hypotheses))
        if "paint" not in description:
            return {"paint": zero, "zero": zero}
        near = self.places.max_of_frames(-np.abs(self.paints - description["paint"]).mean(1))
        return {"paint": near[hypotheses.place], "zero": zero}


class Repainted(Paint):
    """Has the column of another component."""

    name = "repainted"
    columns = (salframe.EvidenceColumn("paint", "difference (0 to 1)", 4.0),)


class Undeclared(Paint):
    """Describes an array that it does not declare."""

    name = "undeclared"

    def describe(self, panorama, description):
        return {"varnish": np.zeros(1)}


class Taking(Paint):
    """Describes an array that the localizer describes."""

    name = "taking"
    arrays = ("labels",)

    def describe(self, panorama, description):
        return {"labels": np.zeros(1)}


class Partial(Paint):
    """Returns one of its two columns."""

    name = "partial"

    def score(self, description, hypotheses):
        return {"paint": np.zeros(len(hypotheses))}


class Infinite(Paint):
    """Returns numbers that are not finite."""

    name = "infinite"

    def score(self, description, hypotheses):
        return dict.fromkeys(("paint", "zero"), np.full(len(hypotheses), np.inf))


class Forgetful(Paint):
    """Stores nothing of what it describes."""

    name = "forgetful"

    def pack(self, description):
        return {}


class Turning(Paint):
    """Compares one column of the image, and declares that its columns do not depend on the heading."""

    name = "turning"

    def describe(self, panorama, description):
        return {} if panorama.rgb is None else {"paint": panorama.rgb[96, 7].astype(float)}


class Loud(Paint):
    """Has a column with capital letters."""

    name = "loud"
    columns = (salframe.EvidenceColumn("Paint", "difference (0 to 1)", 4.0),)


BROKEN = [
    (Undeclared, "array 'varnish', expected only the arrays in its attribute `arrays`: paint"),
    (Taking, "array 'labels', but another component already returned an array of this name: choose another name"),
    (Partial, "'partial' returned the columns paint, expected those in its attribute `columns`: paint, zero"),
    (Infinite, r"the column 'paint' as float64 of shape \(3,\), expected finite numbers as float64 of shape \(3,\)"),
    (Forgetful, r"unpack the bedroom-query: received the arrays \[\], expected those of describe: \['paint'\]"),
    (Turning, r"the localizer with evidence=\[turning\] fails the check poses rotate with the panorama"),
    (Loud, "column 'Paint': received Paint, expected a name of lower-case letters"),
]
"""Components that break a rule, and the message."""


@salframe.hookimpl
def salframe_provides():
    return [Paint, Repainted, *(component for component, _ in BROKEN)]
