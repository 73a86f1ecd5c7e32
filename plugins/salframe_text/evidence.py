"""The evidence `text`: strings that a query and the places of a map have in common, up to reading errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.graphs.packing import TEXTS
from salframe.graphs.texts import edit_distances, text_key
from salframe.localization.evidence_model import EvidenceColumn, EvidenceModel, PlaceFrames, PlaceHypotheses
from salframe.localization.localizer import Description
from salframe.panoramas.panorama import Panorama

STRINGS = "strings"
"""Name of the array with the distinct strings of a panorama."""
ALPHABET = 40
"""Number of characters with which a character may be confused: letters, digits and a few signs."""


class TextEvidence(EvidenceModel):
    """Log likelihood ratio of the strings on signs in the query, in the column `text`.

    The ratio compares the candidate place with a random place, so rare strings count more. It is 0 if the query or the
    place has no string. If a query reads several strings, their log likelihood ratios are added. The sum is limited to
    +-`max_nats`, so that wrong signs cannot overrule the objects.

    If a sign shows the string s, the query reads the string q with the probability (1 - e)^(n - d) (e / 40)^d:

    - e: error rate of a character, `character_error`
    - n: length of the longer string
    - d: edit distance of s and q (Levenshtein 1966)
    - 40: number of characters that can be confused

    With the probability `unmapped`, the string of the sign is not among the strings that the map contains for the
    place of the query. Two cases are then equally likely: the string belongs to a random place of the map, or to none.
    """

    name = "text"
    version = "1"
    columns = (
        EvidenceColumn(
            "text", "log likelihood ratio (nats) of the strings of the query; rare strings count more", weight=1.0
        ),
    )
    arrays = (STRINGS,)

    class Config(ComponentConfig):
        character_error: float = Field(
            0.03, gt=0, lt=0.5, description="probability (0 to 0.5) that a character of a sign is read wrongly"
        )
        unmapped: float = Field(
            0.35,
            gt=0,
            lt=1,
            description="probability (0 to 1) that a string of a query is not among the strings of its place in the "
            "map, for example because the sign was overlooked, replaced or wrong",
        )
        max_nats: float = Field(
            4.0, gt=0, description="maximum absolute value (nats) of the log likelihood ratio of all strings together"
        )

    def describe(self, panorama: Panorama, description: Description) -> Description:
        return _as_array(text_key(text) for text in description.get(TEXTS, ()))

    def join(self, descriptions: Sequence[Description], T_last_view: np.ndarray) -> Description:
        return _as_array(text for description in descriptions for text in description.get(STRINGS, ()))

    def index(self, descriptions: Sequence[Description], places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        of_place: list[set[str]] = [set() for _ in range(len(places.names))]
        for place, frame in zip(places.name[places.place].tolist(), places.frame.tolist(), strict=True):
            of_place[place].update(descriptions[frame].get(STRINGS, np.empty(0, np.str_)).tolist())
        self._places = places
        self._strings = sorted(set[str]().union(*of_place))
        number = {text: i for i, text in enumerate(self._strings)}
        self._has = np.zeros((len(of_place), len(self._strings)), bool)
        for place, texts in enumerate(of_place):
            self._has[place, [number[text] for text in texts]] = True

    def score(self, description: Description, hypotheses: PlaceHypotheses) -> Mapping[str, np.ndarray]:
        total = np.zeros(len(self._has))
        if self._strings:
            for text in description.get(STRINGS, np.empty(0, np.str_)).tolist():
                total += self._ratios(text)
        limited = np.clip(total, -self.config.max_nats, self.config.max_nats)
        return {"text": limited[self._places.name[hypotheses.place]]}

    def _ratios(self, text: str) -> np.ndarray:
        """Return the log likelihood ratio (P,) of one string of a query for each place name, in nats."""
        error, unmapped = self.config.character_error, self.config.unmapped
        distance = edit_distances(text, self._strings)
        length = np.maximum(np.array([len(known) for known in self._strings]), len(text))
        read = np.exp((length - distance) * np.log1p(-error) + distance * np.log(error / ALPHABET))
        count = self._has.sum(1)
        of_place = (self._has @ read) / np.maximum(count, 1)
        of_any_place = of_place[count > 0].mean()
        elsewhere = unmapped * (of_any_place + ALPHABET ** -float(len(text))) / 2
        ratio = ((1 - unmapped) * of_place + elsewhere) / ((1 - unmapped) * of_any_place + elsewhere)
        return np.where(count > 0, np.log(ratio), 0.0)


def _as_array(texts: Iterable[str]) -> Description:
    """Return a description with the distinct strings that are not empty as its only array; {} if there are none."""
    distinct = sorted({str(text) for text in texts} - {""})
    return {STRINGS: np.array(distinct, np.str_)} if distinct else {}
