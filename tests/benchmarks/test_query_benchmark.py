"""The candidates of the scene index against matching all places and panoramas."""

import numpy as np
import pytest

from salframe.framework.files.cache import Cache
from salframe.localization.answers import Localization
from salframe.localization.describing import describe_frame
from salframe.localization.map import LocalizationMap
from salframe.localization.preparing import prepare, silent

pytestmark = pytest.mark.slow


def answers(data: str, *settings: str) -> list[Localization]:
    """The answers of `proposed` to all queries of a dataset."""
    _, dataset, localizer = prepare(data, "proposed", None, ["data.rgb=false", *settings], None, None, silent)
    fold, cache = dataset.folds()[0], Cache()
    built = LocalizationMap.build(localizer, fold.references, cache, dataset.content_key, floors=dataset.floors())
    described = (describe_frame(localizer, query, cache, dataset.content_key)[0] for query in fold.queries)
    return [built.answer(description) for description in described]


@pytest.mark.parametrize("data", ["house-42", "house-106"])
def test_the_candidates_hold_what_matching_all_finds(data):
    """The first place differs for at most one query of 500."""
    some, every = answers(data), answers(data, "candidates=100000", "matcher.max_candidates=null")
    first = np.array([[answer.places[0].place for answer in side] for side in (some, every)])
    assert (first[0] != first[1]).sum() <= len(some) / 500
