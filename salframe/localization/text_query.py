"""Parse a description of a room in words: the objects, how many there are, and their order as seen by the writer."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from salframe.framework.errors import DataError
from salframe.graphs.nearest_words import WordVectors
from salframe.graphs.vocabulary import is_object, object_label

MAX_CHARACTERS = 2000
"""Maximum length of a description."""
MAX_COUNT = 50
"""Maximum number of objects of one kind in a description."""
_NUMBERS = ("a", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_COUNTS = {word: number for number, word in enumerate(_NUMBERS, 1)} | {"one": 1, "pair of": 2, "couple of": 2}
_NEGATIONS = ("no", "not", "without")
_COLOURS = frozenset(
    ("red", "green", "blue", "yellow", "black", "white", "grey", "gray", "brown", "orange", "purple", "pink", "beige")
)
_IGNORED = frozenset(
    ("a", "an", "the", "some", "there", "is", "are", "i", "see", "can", "we", "my", "our", "it", "also", "of", "on")
)
_LEADING = frozenset([*_IGNORED, *_NEGATIONS, *_NUMBERS, "one", "pair", "couple"])
_RELATIONS = re.compile(r"\b(?:to |on )?(?:the )?(left|right) (?:of|from)\b|\b(opposite|across)(?: to| of| from)?\b")
_SEPARATORS = re.compile(r"[,;.\n]|\band\b|\bwith\b|\bplus\b|\b(?=without\b)")


class Direction(StrEnum):
    """Direction of an object relative to another object, as seen by the person who wrote the description."""

    LEFT = "left of"
    RIGHT = "right of"
    OPPOSITE = "opposite"


@dataclass(frozen=True)
class Mention:
    """An object that a description mentions.

    Attributes:
        word: The words for the object in the description.
        label: The object label; None if the words are not known.
        count: Number of such objects; None: at least one.
        is_absent: Whether the description says that there is no such object.
        is_nearest: Whether `label` is a guess. The words are then neither in the vocabulary nor among the labels of the
            map, and `label` is the word of the vocabulary with the most similar word vector.
    """

    word: str
    label: str | None
    count: int | None = None
    is_absent: bool = False
    is_nearest: bool = False


@dataclass(frozen=True)
class Relation:
    """The stated order of two objects of a description, such as "first is left of second".

    Attributes:
        first: Index of the first object in `TextQuery.mentions`.
        direction: The order.
        second: Index of the second object in `TextQuery.mentions`.
    """

    first: int
    direction: Direction
    second: int


@dataclass(frozen=True)
class TextQuery:
    """A parsed description.

    Attributes:
        mentions: The objects that the description mentions.
        relations: The stated orders of two objects.
        notes: Remarks on replaced, ignored and unknown words, one line each.
    """

    mentions: tuple[Mention, ...]
    relations: tuple[Relation, ...]
    notes: tuple[str, ...] = field(default=(), compare=False)


def read_text(text: str, labels: Sequence[str], vectors: WordVectors | None = None) -> TextQuery:
    """Parse a description such as "red sofa, two plants left of the bed".

    Commas and "and" separate objects. An object may have a number ("two plants") or "no". "left of", "right of" or
    "opposite" states the order of two objects. Synonyms are replaced by their name in the vocabulary. A word that is
    neither in the vocabulary nor in `labels` is replaced by the nearest word of the vocabulary.

    Args:
        text: The description, in English.
        labels: The object labels of the map. They are valid words, like the words of the vocabulary.
        vectors: Word vectors that determine the nearest word; None: the vectors of the package wordllama.

    Raises:
        DataError: The text is longer than MAX_CHARACTERS, or names no object.
    """
    if len(text) > MAX_CHARACTERS:
        raise DataError(
            f"the description has {len(text)} characters, expected at most {MAX_CHARACTERS}: shorten the description"
        )
    reader = _Reader(frozenset(labels), vectors or WordVectors())
    mentions: list[Mention] = []
    relations: list[Relation] = []
    for clause in _SEPARATORS.split(text.casefold()):
        direction, previous, end = None, None, 0
        for match in (*_RELATIONS.finditer(clause), None):
            mention = reader.mention(clause[end : None if match is None else match.start()])
            if mention is not None:
                mentions.append(mention)
                if direction is not None and previous is not None:
                    relations.append(Relation(previous, direction, len(mentions) - 1))
                previous = len(mentions) - 1
            if match is not None:
                side, end = match[1], match.end()
                direction = Direction.OPPOSITE if side is None else Direction(f"{side} of")
    if not mentions:
        raise DataError(f"the description {text[:100]!r} names no object, expected objects such as 'sofa, two plants'")
    return TextQuery(tuple(mentions), tuple(relations), tuple(dict.fromkeys(reader.notes)))


class _Reader:
    """Parses the phrases of a description, and collects notes."""

    def __init__(self, labels: frozenset[str], vectors: WordVectors) -> None:
        self._labels, self._vectors = labels, vectors
        self.notes: list[str] = []

    def mention(self, phrase: str) -> Mention | None:
        """Return the object that a phrase mentions; None if the phrase has no word for an object."""
        words = re.findall(r"[^\W_]+(?:['-][^\W_]+)*", phrase)
        is_absent = any(word in _NEGATIONS for word in words)
        count = _count(words)
        colours = [word for word in words if word in _COLOURS]
        if colours and len(colours) < len(words):
            self.notes.append(f"ignored colours, because the map does not store colours: {', '.join(colours)}")
            words = [word for word in words if word not in _COLOURS]
        while words and (words[0] in _LEADING or words[0].isdecimal()):
            words = words[1:]
        while words and words[-1] in _IGNORED:
            words = words[:-1]
        if not words:
            return None
        for start in range(len(words)):
            word = " ".join(words[start:])
            label = object_label(word)
            if label in self._labels or is_object(label) is not None:
                if start:
                    self.notes.append(f"ignored words: {' '.join(words[:start])!r} in {' '.join(words)!r}")
                if label not in self._labels and is_object(label) is False:
                    self.notes.append(f"{word!r} does not name an object that a map stores")
                return Mention(word, label, count, is_absent)
        word = " ".join(words)
        nearest = self._vectors.nearest(word)
        if nearest is None:
            self.notes.append(
                f"{word!r} is ignored: the word is not in the vocabulary of object names{self._vectors.reason}"
            )
            return Mention(word, None, count, is_absent)
        label = object_label(nearest)
        self.notes.append(f"{word!r} is not in the vocabulary of object names; its nearest word is {nearest!r}")
        return Mention(word, label, count, is_absent, is_nearest=True)


def _count(words: Sequence[str]) -> int | None:
    """Return the number of objects that the words state; None if they state no number, as in "a chair"."""
    for number, word in enumerate(words):
        two = " ".join(words[number : number + 2])
        if word.isdecimal() and len(word) < 4:
            return min(max(int(word), 1), MAX_COUNT)
        if two in _COUNTS:
            return _COUNTS[two]
        if word in _COUNTS and word != "a":
            return _COUNTS[word]
    return None
