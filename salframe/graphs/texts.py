"""Comparison of texts that were read on signs."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

import numpy as np


def text_key(text: str) -> str:
    """Return a text in a form for comparison: in lower case, without spaces, and normalized by Unicode NFKC.

    Spaces are removed because text recognition (OCR) often misses them.
    """
    return "".join(unicodedata.normalize("NFKC", text).casefold().split())


def edit_distances(text: str, others: Sequence[str]) -> np.ndarray:
    """Return the edit distance (Levenshtein 1966) of a text to each of N others, (N,) int64.

    The distance is the minimum number of characters to insert, delete or replace.
    """
    lengths = np.array([len(other) for other in others], np.int64)
    width = int(lengths.max(initial=0))
    codes = np.zeros((len(others), width), np.int64)
    for row, other in zip(codes, others, strict=True):
        row[: len(other)] = [ord(character) for character in other]
    column = np.arange(width + 1)
    distance = np.tile(column, (len(others), 1))  # from the empty text to each prefix of each other text
    for count, character in enumerate(text, 1):
        replaced = distance[:, :-1] + (codes != ord(character))
        best = np.minimum(replaced, distance[:, 1:] + 1)
        best = np.column_stack([np.full(len(others), count), best])
        distance = np.minimum.accumulate(best - column, axis=1) + column  # insertions, from left to right
    return np.asarray(distance[np.arange(len(others)), lengths])
