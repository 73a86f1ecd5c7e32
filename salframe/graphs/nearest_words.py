"""The nearest word in the vocabulary for a word outside the vocabulary, by static word vectors."""

from __future__ import annotations

from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from salframe.graphs.vocabulary import vocabulary_words

MIN_SIMILARITY = 0.6
"""Minimum cosine similarity of a word and its nearest word. Less similar words are often wrong ("icebox" and "mailbox":
0.47)."""
PACKAGE, PIP_COMMAND = "wordllama", "pip install 'salframe[words]'"


class WordVectors:
    """Word vectors of the package wordllama. They are read from the installed package, without a download."""

    @cached_property
    def is_installed(self) -> bool:
        """Whether the package is installed."""
        return find_spec(PACKAGE) is not None

    @property
    def reason(self) -> str:
        """The reason why `nearest` returned None, as the end of a sentence."""
        if self.is_installed:
            return " and resembles no word in the vocabulary"
        return f"; to search for similar words, install the package {PACKAGE}: {PIP_COMMAND}"

    def nearest(self, word: str) -> str | None:
        """Return the most similar word of the vocabulary; None if its similarity is below MIN_SIMILARITY, or the
        package is not installed."""
        if not self.is_installed:
            return None
        words, vectors = self._vocabulary
        similarity = vectors @ self._embed([word])[0]
        best = int(np.argmax(similarity))
        return words[best] if similarity[best] >= MIN_SIMILARITY else None

    @cached_property
    def _vocabulary(self) -> tuple[tuple[str, ...], np.ndarray]:
        """The words of the vocabulary, and their unit vectors (N, D)."""
        words = vocabulary_words()
        return words, self._embed(words)

    def _embed(self, words: list[str] | tuple[str, ...]) -> np.ndarray:
        """Return the unit vectors of words, (N, D)."""
        vectors: np.ndarray = self._model.embed(list(words), norm=True)
        return vectors

    @cached_property
    def _model(self) -> Any:
        import wordllama

        return wordllama.WordLlama.load(cache_dir=str(Path(wordllama.__file__).parent), disable_download=True)
