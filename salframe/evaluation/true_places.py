"""Compare the true places of queries with the places of the map, to find names that differ only in their spelling."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Sequence

from salframe.framework.errors import TruthMissing
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.opening import reference_frames

MAX_NAMES = 3
"""Maximum number of names that a note lists."""


def place_key(name: str) -> str:
    """Return a key that is the same for different spellings of the name of a place.

    Names that differ only in Unicode composition, case, white space, underscores or hyphens have the same key.
    """
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    return " ".join(folded.replace("_", " ").replace("-", " ").split())


def places_notes(dataset: Dataset) -> list[str]:
    """Return warnings on true places of queries that are missing in the map, at most one line of each kind.

    The first line lists true places that the map has in another spelling. The second line lists the other missing
    places, whose queries are out of the map.
    """
    mapped = {frame.place for frame in reference_frames(dataset)}
    queries = {query.id for fold in dataset.folds() for query in fold.queries}
    true_places = (_true_place(dataset, query) for query in sorted(queries))
    counts = Counter(place for place in true_places if place is not None and place not in mapped)
    spellings: dict[str, str] = {}
    for place in sorted(mapped):
        spellings.setdefault(place_key(place), place)
    misspelt = [place for place in counts if place_key(place) in spellings]
    others = [place for place in counts if place_key(place) not in spellings]
    notes = []
    if misspelt:
        pairs = [f"{place!r} (did you mean {_spell(spellings[place_key(place)], place)}?)" for place in misspelt]
        notes.append(
            f"warning: the true place of {_queries(counts, misspelt)} counts as out of map, because the map has "
            f"another spelling: {_list(pairs)}; use one spelling in the truth file and in the map"
        )
    if others:
        notes.append(
            f"the true place of {_queries(counts, others)} is not in the map, so the correct answer is out-of-map: "
            f"{_list([repr(place) for place in others])}"
        )
    return notes


def _true_place(dataset: Dataset, query: str) -> str | None:
    try:
        return dataset.truth(query).place
    except TruthMissing:  # the evaluation reports it
        return None


def _spell(place: str, other: str) -> str:
    """Return the name of a place. If it looks the same as the other name, add the form of its Unicode characters."""
    if unicodedata.normalize("NFC", place) != unicodedata.normalize("NFC", other):
        return repr(place)
    form = "composed" if unicodedata.is_normalized("NFC", place) else "decomposed"
    return f"{place!r} in {form} Unicode"


def _queries(counts: Counter[str], places: Sequence[str]) -> str:
    count = sum(counts[place] for place in places)
    return "1 query" if count == 1 else f"{count} queries"


def _list(names: Sequence[str]) -> str:
    more = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {more} more" if more > 0 else "")
