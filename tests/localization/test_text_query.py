"""Descriptions of rooms in words: which objects, numbers and orders are read."""

from __future__ import annotations

import pytest

from salframe.framework.errors import DataError
from salframe.graphs import nearest_words
from salframe.localization.text_query import Direction, Mention, Relation, read_text

LABELS = ("sofa", "plant", "bed", "spinning jenny")


def labels(text: str) -> list[str | None]:
    return [mention.label for mention in read_text(text, LABELS).mentions]


def test_objects_numbers_orders_and_colours_are_read():
    query = read_text("red sofa, two plants left of the bed", LABELS)
    assert query.mentions == (Mention("sofa", "sofa"), Mention("plants", "plant", 2), Mention("bed", "bed"))
    assert query.relations == (Relation(1, Direction.LEFT, 2),)
    assert query.notes == ("ignored colours, because the map does not store colours: red",)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("I see a couch and a TV", ["sofa", "television"]),
        ("chest of drawers; the stairs", ["chest of drawers", "stairs"]),
        ("a pair of potted plants with 3 lamps", ["plant", "lamp"]),
        ("spinning jennies", ["spinning jenny"]),
        ("Dining Table.", ["dining table"]),
    ],
)
def test_words_are_compared_through_the_vocabulary(text, expected):
    assert labels(text) == expected


def test_numbers():
    query = read_text("a pair of plants, 3 sofas, one bed, a bed, twelve plants, beds", LABELS)
    assert [mention.count for mention in query.mentions] == [2, 3, 1, None, 12, None]


def test_absent_objects():
    query = read_text("a bed without plants, no sofa", LABELS)
    assert [(mention.label, mention.is_absent) for mention in query.mentions] == [
        ("bed", False),
        ("plant", True),
        ("sofa", True),
    ]


def test_orders_connect_neighbouring_objects():
    query = read_text("the bed is to the right of a plant opposite the sofa", LABELS)
    assert query.relations == (Relation(0, Direction.RIGHT, 1), Relation(1, Direction.OPPOSITE, 2))
    assert read_text("left of the bed", LABELS).relations == ()


def test_the_nearest_word_is_reported():
    pytest.importorskip("wordllama")
    query = read_text("curtaining", LABELS)
    (mention,) = query.mentions
    assert (mention.label, mention.is_nearest) == ("curtain", True)
    assert query.notes == ("'curtaining' is not in the vocabulary of object names; its nearest word is 'curtain'",)
    (unknown,) = read_text("xyzzy", LABELS).mentions
    assert unknown.label is None


def test_without_the_package_a_word_is_reported_with_the_command(monkeypatch):
    monkeypatch.setattr(nearest_words, "PACKAGE", "no_such_package")
    query = read_text("espresso maker, sofa", LABELS)
    assert [mention.label for mention in query.mentions] == [None, "sofa"]
    (note,) = query.notes
    assert note == (
        "'espresso maker' is ignored: the word is not in the vocabulary of object names; to "
        "search for similar words, install the "
        "package no_such_package: pip install 'salframe[words]'"
    )


@pytest.mark.parametrize("text", ["", " , and ", "the", "x" * 3000])
def test_texts_without_objects_are_refused(text):
    with pytest.raises(DataError, match="the description"):
        read_text(text, LABELS)
