"""Keys and edit distances of texts, compared with the recursive definition of the distance."""

from functools import cache

import numpy as np

from salframe.graphs.texts import edit_distances, text_key


@cache
def levenshtein(a: str, b: str) -> int:
    """Return the edit distance by its definition."""
    if not a or not b:
        return len(a) + len(b)
    return min(levenshtein(a[1:], b) + 1, levenshtein(a, b[1:]) + 1, levenshtein(a[1:], b[1:]) + (a[0] != b[0]))


def test_a_key_has_no_case_and_spaces_and_one_form_of_equal_characters():
    assert text_key(" Office  7 ") == text_key("OFFICE\uff17") == "office7"
    assert text_key("STRASSE") == text_key("Straße")
    assert text_key(" ") == ""


def test_edit_distances_are_those_of_the_definition():
    rng = np.random.default_rng(3)
    texts = ["".join(rng.choice(list("abc"), rng.integers(0, 9))) for _ in range(60)]
    for text in texts[:15]:
        assert edit_distances(text, texts).tolist() == [levenshtein(text, other) for other in texts]
    assert edit_distances("kitten", ["sitting", "", "kitten"]).tolist() == [3, 6, 0]
    assert edit_distances("kitten", []).tolist() == []
