"""Comparison of texts that were read on signs."""

from __future__ import annotations

import unicodedata


def text_key(text: str) -> str:
    """Return a text for comparison: without case and spaces, and with one form of characters of equal meaning (NFKC).

    Readers often miss the spaces of a text.
    """
    return "".join(unicodedata.normalize("NFKC", text).casefold().split())
