"""Fit what the scores of a method are worth on tuning data: its posterior."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from salframe.evaluation.task import check_needs
from salframe.framework.cache import Cache
from salframe.framework.errors import FRAME_ERRORS, ConfigError, DataError
from salframe.framework.files import write_text
from salframe.framework.identity import digest, identity
from salframe.framework.installation import installed_version
from salframe.framework.presets import SUFFIXES
from salframe.localization.answers import Localization
from salframe.localization.localizer import Description, Localizer
from salframe.localization.posterior import Fit, ScoredAnswer, fit_posterior
from salframe.localization.saved_map import Tell, prepare, silent
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold, MapFrame, QueryFrame
from salframe.panoramas.opening import Progress

HIDE = "data.hide_query_place=true"
"""What is set of every tuning data set."""


def fit_method(
    method: str,
    data: Sequence[str],
    output: Path,
    *,
    data_dir: Path | None = None,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
    tell: Tell = silent,
) -> Fit:
    """Ask a method the queries of tuning data, with their place in the map and without, fit its posterior to the
    scores, and write the file that its setting `posterior` takes, with where the numbers come from.

    `data`: names of data sets, at least one; overrides: "key.path=value" each, as for a map. Raises ConfigError where
    the method takes no posterior or the file's name is none of YAML, and DataError where its scores tell nothing.
    """
    if output.suffix not in SUFFIXES:
        raise ConfigError(f"received the file {output}, expected one that ends in {' or '.join(SUFFIXES)}")
    if not data:
        raise ConfigError("received no tuning data, expected at least one data set")
    answers: list[ScoredAnswer] = []
    asked: list[dict[str, Any]] = []
    known: dict[str, Any] = {}
    for one in data:
        name, dataset, localizer = prepare(one, method, data_dir, [*overrides, HIDE], progress, tell)
        if "posterior" not in type(localizer.config).model_fields:
            raise ConfigError(
                f"{name} is a {localizer.name!r}, which has no setting `posterior`: "
                "its answers cannot carry probabilities"
            )
        check_needs(localizer, dataset)
        tune = localizer.config.model_copy(update={"posterior": None})
        known = {"name": name, "localizer": localizer.name, "identity": digest(identity(tune))}
        found = list(ask(localizer, dataset, progress and partial(progress, f"{name} on {one}")))
        asked.append({"name": one, "key": dataset.question_key, "queries": len(found)})
        answers += [answer for answer in found if answer is not None]
    try:
        fit = fit_posterior(answers)
    except DataError as error:
        raise DataError(f"{method} cannot be fitted: {error}") from None
    gain = {
        "place": {"answers": fit.place_answers, "before": fit.place_nll_before, "after": fit.place_nll_after},
        "here": {"answers": fit.answers, "before": fit.here_nll_before, "after": fit.here_nll_after},
    }
    provenance = {
        "method": known,
        "data": asked,
        "set": list(overrides),
        "mean_negative_log_likelihood": gain,
        "salframe": installed_version("salframe"),
    }
    content = {"posterior": fit.posterior.model_dump(mode="json"), "provenance": provenance}
    write_text(output, yaml.safe_dump(content, sort_keys=False))
    return fit


def ask(localizer: Localizer, dataset: Dataset, progress: Any = None) -> Iterator[ScoredAnswer | None]:
    """The scores of a method's answer to each query of each fold, and what is true of it; None of an answer without
    places, and of a query that cannot be described. Mapping frames that cannot be described are left out."""
    folds, cache = dataset.folds(), Cache()
    total, done = sum(len(fold.queries) for fold in folds), 0
    descriptions: dict[str, Description | None] = {}

    def describe(frame: MapFrame | QueryFrame) -> Description | None:
        if frame.id not in descriptions:
            try:
                descriptions[frame.id] = localizer.describe_frame(frame, cache, dataset.content_key)[0]
            except FRAME_ERRORS:
                descriptions[frame.id] = None
        return descriptions[frame.id]

    for fold in folds:
        usable = [(frame, found) for frame in fold.mapping if (found := describe(frame)) is not None]
        if not usable:
            raise DataError(f"fold {fold.id} has no mapping frame that {localizer.name} can use")
        localizer.take_map([found for _, found in usable], [frame for frame, _ in usable])
        for query in fold.queries:
            if progress:
                progress(done, total)
            done += 1
            seen = describe(query)
            if seen is None:
                yield None
            else:
                place = dataset.truth(query.id).place
                yield _scored(localizer.match(seen), place, fold, localizer.count_objects(seen))


def _scored(answer: Localization, place: str, fold: Fold, objects: int) -> ScoredAnswer | None:
    """An answer with what is true of it, None without places; `place`: the query's."""
    if not answer.places:
        return None
    names = [ranked.place for ranked in answer.places]
    scores = np.array([ranked.score for ranked in answer.places], np.float64)
    here = any(frame.place == place for frame in fold.mapping)
    return ScoredAnswer(scores, names.index(place) if place in names else None, here, objects)


def summary(fit: Fit) -> list[str]:
    """What a fit found, lines to read."""
    return [
        f"temperature {fit.posterior.temperature:.4g}: of {fit.place_answers} answers that rank the query's place, "
        f"mean -ln(its share of the places) {fit.place_nll_after:.3f}, {fit.place_nll_before:.3f} at temperature 1",
        f"head: of {fit.answers} answers, the query's place in the map or not, mean -ln(probability of what is so) "
        f"{fit.here_nll_after:.3f}, {fit.here_nll_before:.3f} knowing only how many are",
    ]
