"""Find the places of a map that fit a description in words, and the question that best distinguishes these places."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from salframe.framework.errors import InputMissing
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import GRAPH_ARRAYS, graph_from_arrays
from salframe.graphs.vocabulary import common_label
from salframe.localization.answers import RankedPlace
from salframe.localization.map import LocalizationMap
from salframe.localization.text_query import Direction, Mention, TextQuery, read_text
from salframe.panoramas.frames import FrameKind
from salframe.panoramas.geometry import wrap_angle

WRONG_WORD_SHARE = 0.35
"""Assumed share of the objects in a description that the map does not contain at the described place: wrong words, and
objects that the detector missed. Chosen on house-42, seeds 100 and 101, with 10 % wrong words."""
COUNT_DECREASE = 1.0
"""Decrease of the log probability (nats) of a stated number of objects, for each object by which this number differs
from the number in the map."""
RELATION_SHARE = 0.8
"""Assumed probability that a stated order of two objects, such as "left of", is correct around a reference frame that
shows both objects."""
SIDE_RAD, OPPOSITE_RAD = np.radians(150), np.radians(120)
"""Maximum difference in azimuth, in radians, between an object and an object to its left or right, and minimum
difference between opposite objects."""
ANSWER_SHARE = 0.9
"""Assumed probability that a user says yes to a question about an object that the map contains at the place of the
user, and no to a question about any other object."""
MIN_GAIN_NATS = 1e-9
"""Minimum expected decrease of the entropy by a question, in nats. A question with a smaller decrease is left out."""
NUM_PLACES = 5
"""Maximum number of places to print."""


@dataclass(frozen=True)
class Question:
    """A yes-or-no question about an object.

    Attributes:
        label: Label of the object.
        text: The question.
        expected_entropy: Expected entropy, after the answer, of the probabilities of the places, in nats.
    """

    label: str
    text: str
    expected_entropy: float


@dataclass(frozen=True)
class TextAnswer:
    """Places of a map that fit a description in words.

    Attributes:
        places: All places of the map, best first, each with its frame that fits best. The score is the log-likelihood
            of the description. The probabilities sum to 1, because the described place is assumed to be in the map.
        query: The parsed description.
        entropy: Entropy of the probabilities of the places, in nats.
        question: The question that is expected to reduce the entropy most; None if no question reduces it.
        notes: Remarks on replaced, ignored and unknown words, one line each.
    """

    places: tuple[RankedPlace, ...]
    query: TextQuery
    entropy: float
    question: Question | None
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the answer as JSON, with at most NUM_PLACES places."""
        return {
            "places": [place._asdict() for place in self.places[:NUM_PLACES]],
            "mentions": [asdict(mention) for mention in self.query.mentions],
            "relations": [asdict(relation) for relation in self.query.relations],
            "entropy": self.entropy,
            "question": None if self.question is None else asdict(self.question),
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        """The best NUM_PLACES places with their probabilities, the question and the notes, one line each."""
        lines = [f"{place.probability:10.1%}  {place.place}" for place in self.places[:NUM_PLACES]]
        if others := self.places[NUM_PLACES:]:
            lines.append(f"{sum(place.probability or 0.0 for place in others):10.1%}  other places ({len(others)})")
        if self.question is not None:
            lines.append(f"question: {self.question.text}")
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def ask(map: LocalizationMap, text: str) -> TextAnswer:
    """Return the places of a map that fit a description in words.

    The objects in the description, and the stated orders of two objects ("left of"), are treated as independent.

    Args:
        map: The map.
        text: The description, as in `read_text`.

    Raises:
        DataError: The description is too long, or names no object.
        InputMissing: The map stores no objects.
    """
    scenes = MapWords(map)
    return scenes.answer(read_text(text, scenes.labels))


class MapWords:
    """The labels and directions of the objects of a map. Descriptions in words are compared with them.

    If the map has scene frames (frames in rooms), only these are used, and frames in doorways are ignored.

    Attributes:
        labels: The L distinct labels of the objects.
        places: Names of the K places.
    """

    def __init__(self, map: LocalizationMap) -> None:
        """Read the objects of a map. Raises InputMissing if it stores none."""
        scenes = [frame for frame in map.frames if frame.kind is FrameKind.SCENE]
        self._frames = scenes or list(map.frames)
        descriptions = [map.reference(frame.id)[1] for frame in self._frames]
        if not all(description.keys() >= GRAPH_ARRAYS for description in descriptions):
            raise InputMissing(
                f"the map was built with the method {map.localizer.name!r}, which stores no objects, expected a method "
                "that detects objects, such as 'proposed'"
            )
        self._graphs = [graph_from_arrays(description) for description in descriptions]
        self.labels = tuple(sorted({label for graph in self._graphs for label in graph.labels}))
        number = {label: row for row, label in enumerate(self.labels)}
        self.places = tuple(dict.fromkeys(frame.place for frame in self._frames))
        row_of_place = {place: row for row, place in enumerate(self.places)}
        self._place = np.array([row_of_place[frame.place] for frame in self._frames], int)
        self._count = np.zeros((len(self.places), len(self.labels)))
        for place, graph in zip(self._place, self._graphs, strict=True):
            count = np.bincount(np.array([number[label] for label in graph.labels], int), minlength=len(self.labels))
            self._count[place] = np.maximum(self._count[place], count)

    def answer(self, query: TextQuery) -> TextAnswer:
        """Return the places that fit a parsed description."""
        of_frames = np.zeros(len(self._frames))
        for relation in query.relations:
            first, second = query.mentions[relation.first], query.mentions[relation.second]
            of_frames += self._relation_log_likelihood(first, relation.direction, second)
        score = np.full(len(self.places), -np.inf)
        np.logaddexp.at(score, self._place, of_frames)
        score -= np.log(np.bincount(self._place))
        for mention in query.mentions:
            score += self._mention_log_likelihood(mention)
        probability = np.exp(score - np.logaddexp.reduce(score))
        order = np.argsort(-score, kind="stable")
        best = [max(np.flatnonzero(self._place == place), key=lambda row: of_frames[row]) for place in order]
        places = tuple(
            RankedPlace(self._frames[row].id, self.places[place], float(score[place]), float(probability[place]))
            for place, row in zip(order, best, strict=True)
        )
        named = [mention for mention in query.mentions if mention.label is not None]
        absent = [mention.word for mention in named if not self._matching(mention).any()]
        notes = [f"no object of the map has the label {word!r}" for word in dict.fromkeys(absent)]
        question = self._question(query, probability)
        return TextAnswer(places, query, _entropy(probability), question, (*query.notes, *notes))

    def _matching(self, mention: Mention) -> np.ndarray:
        """Return which labels of the map an object of a description may have, (L,) bool.

        These are the label itself and special kinds of it ("dining table" for "table"). If the map has none of these,
        they are all labels with the same `common_label`.
        """
        exact = np.array([mention.label in (label, common_label(label)) for label in self.labels], bool)
        if exact.any() or mention.label is None:
            return exact
        kind = common_label(mention.label)
        return np.array([kind == common_label(label) for label in self.labels], bool)

    def _mention_log_likelihood(self, mention: Mention) -> np.ndarray:
        """Return the log-likelihood of an object of a description for each place, (K,); 0 if the word is unknown or no
        object of the map has the label."""
        meant = self._matching(mention)
        if not meant.any():
            return np.zeros(len(self.places))
        count = self._count[:, meant].sum(1)
        if mention.is_absent:
            return np.log(np.where(count > 0, 1 - ANSWER_SHARE, ANSWER_SHARE))
        num_labels = (self._count > 0).sum(1)
        share = (count > 0) / np.maximum(num_labels, 1)
        if mention.count is not None:
            share = share * np.exp(-COUNT_DECREASE * np.abs(count - mention.count))
        elsewhere = (count > 0).mean() / num_labels.mean()
        mixed: np.ndarray = np.log((1 - WRONG_WORD_SHARE) * share + WRONG_WORD_SHARE * elsewhere)
        return mixed

    def _relation_log_likelihood(self, first: Mention, direction: Direction, second: Mention) -> np.ndarray:
        """Return the log-likelihood of the stated order of two objects for each frame, (F,)."""
        a, b = (
            {label for label, is_meant in zip(self.labels, self._matching(mention), strict=True) if is_meant}
            for mention in (first, second)
        )
        share = np.array([_correct_pair_share(graph, a, direction, b) for graph in self._graphs])
        probability = (1 - RELATION_SHARE) + (2 * RELATION_SHARE - 1) * share
        return np.where(np.isnan(share), np.log(0.5), np.log(probability))

    def _question(self, query: TextQuery, probability: np.ndarray) -> Question | None:
        """Return the question with the smallest expected entropy after its answer; None if no question decreases the
        entropy by MIN_GAIN_NATS.

        Args:
            query: The description. No question is about an object that it mentions.
            probability: (K,) probability of each place.
        """
        mentioned = np.zeros(len(self.labels), bool)
        for mention in query.mentions:
            mentioned |= self._matching(mention)
        yes = np.where(self._count > 0, ANSWER_SHARE, 1 - ANSWER_SHARE).T * probability
        expected = np.array(
            [sum(part.sum() * _entropy(part / part.sum()) for part in (share, probability - share)) for share in yes]
        )
        expected[mentioned] = np.inf
        best = int(np.argmin(expected)) if len(expected) else 0
        if not len(expected) or not expected[best] < _entropy(probability) - MIN_GAIN_NATS:
            return None
        return Question(self.labels[best], _question_text(self.labels[best]), float(expected[best]))


def _correct_pair_share(graph: SaliencyGraph, first: set[str], direction: Direction, second: set[str]) -> float:
    """Return the share of pairs of objects in a graph for which `direction` is correct around the camera.

    A pair consists of an object with a label in `first` and an object with a label in `second`. Return NaN if there are
    no pairs.
    """
    azimuth_rad = np.arctan2(graph.bearing[:, 1], graph.bearing[:, 0])
    a, b = (np.flatnonzero([label in labels for label in graph.labels]) for labels in (first, second))
    left_rad = np.array([wrap_angle(azimuth_rad[i] - azimuth_rad[j]) for i in a for j in b if i != j])
    if not len(left_rad):
        return float("nan")
    if direction is Direction.OPPOSITE:
        return float((np.abs(left_rad) >= OPPOSITE_RAD).mean())
    side_rad = left_rad if direction is Direction.LEFT else -left_rad
    return float(((side_rad > 0) & (side_rad <= SIDE_RAD)).mean())


def _entropy(probability: np.ndarray) -> float:
    """Return the entropy of probabilities in nats."""
    positive = probability[probability > 0]
    return float(-(positive * np.log(positive)).sum())


def _question_text(label: str) -> str:
    """Return the text of the question whether there is an object with a label."""
    if label.endswith("s") and not label.endswith(("ss", "us", "of drawers")):
        return f"Are there {label}?"
    return f"Is there {'an' if label[:1] in 'aeiou' else 'a'} {label}?"
