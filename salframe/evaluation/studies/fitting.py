"""Fit a method to tuning data: its matching settings, the weights of its evidence, and its posterior."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from salframe.evaluation.runs.inputs import check_needs
from salframe.framework.components.identity import identity
from salframe.framework.components.installation import installed_version
from salframe.framework.components.presets import SUFFIXES, settings
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import flatten, spell_value
from salframe.framework.config import merge, parse_override
from salframe.framework.errors import FRAME_ERRORS, ConfigError, DataError
from salframe.framework.files.cache import Cache
from salframe.framework.files.hashes import digest
from salframe.framework.files.writing import write_text
from salframe.framework.overrides import nest
from salframe.framework.validation import validate
from salframe.localization.describing import describe_frame
from salframe.localization.evidence import Evidence, fit_weights
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.posterior_fit import Fit, ScoredAnswer, fit_posterior
from salframe.localization.preparing import Tell, prepare, silent
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame
from salframe.panoramas.opening import Progress

HIDE = "data.hide_query_place=true"
"""Setting of every tuning dataset: each query is also localized in a map without its place."""


@dataclass(frozen=True, eq=False)
class TuningData:
    """A dataset to tune on.

    Attributes:
        name: Name of the dataset.
        dataset: The dataset.
        localizer: The localizer that is tuned.
        descriptions: Description of each frame by id; None if the localizer cannot use the frame.
    """

    name: str
    dataset: Dataset
    localizer: Localizer
    descriptions: Mapping[str, Description | None]

    @cached_property
    def num_objects(self) -> dict[str, int]:
        """Mapping from the id of each scene frame (reference frame in a room) that the localizer can use to its number
        of objects."""
        return {
            frame.id: self.localizer.count_objects(description)
            for fold in self.dataset.folds()
            for frame in fold.references
            if frame.kind is FrameKind.SCENE and (description := self.descriptions[frame.id]) is not None
        }

    @cached_property
    def map_key(self) -> str:
        """Digest of the ids, poses and numbers of objects of the scene frames (reference frames in rooms). Data sets
        that differ only in their queries have the same digest."""
        poses = {frame.id: frame.T_world_pano.tolist() for fold in self.dataset.folds() for frame in fold.references}
        return digest(sorted((id, count, poses[id]) for id, count in self.num_objects.items()))

    def iterate_queries(
        self, changes: Mapping[str, Any], absent: bool = True
    ) -> Iterator[tuple[Localizer, Description, str, bool]]:
        """Yield each query, with a localizer that has the settings `changes` and the map of the query.

        Args:
            changes: Settings that replace those of the localizer.
            absent: Whether to include folds (maps with their queries) in which no query has its place in the map.

        Yields:
            The localizer with the map of the fold, the description of the query, its true place, and whether the map
            contains that place.
        """
        config = merge(self.localizer.config.model_dump(mode="json"), changes)
        localizer: Localizer = type(self.localizer)(validate(type(self.localizer).Config, config, ""))
        if localizer.describe_identity() != self.localizer.describe_identity():
            received = ", ".join(f"{key}={spell_value(value)}" for key, value in flatten(changes).items())
            raise ConfigError(
                f"--try received {received}, which changes the descriptions (features) of panoramas, expected settings "
                "of the matching: fit the method once for each value, with --set"
            )
        for fold in self.dataset.folds():
            places = [self.dataset.truth(query.id).place for query in fold.queries]
            here = [any(frame.place == place for frame in fold.references) for place in places]
            if not (absent or any(here)):
                continue
            usable = [
                (frame, description)
                for frame in fold.references
                if (description := self.descriptions[frame.id]) is not None
            ]
            if not usable:
                raise DataError(
                    f"the map {fold.id} of the tuning data has no reference frame (panorama of the map) that the "
                    f"method {localizer.name} can use, expected at least one: check the dataset with "
                    "`salframe data info`, or use other tuning data"
                )
            frames, described = [frame for frame, _ in usable], [description for _, description in usable]
            fold_map = LocalizationMap.from_descriptions(localizer, described, frames, self.dataset.floors())
            for query, place, is_here in zip(fold.queries, places, here, strict=True):
                description_of_query = self.descriptions[query.id]
                if description_of_query is not None:
                    yield fold_map.localizer, description_of_query, place, is_here


def fit_method(
    method: str,
    data: Sequence[str],
    output: str | Path,
    *,
    tries: Sequence[str] = (),
    posterior_only: bool = False,
    data_dir: str | Path | None = None,
    overrides: Sequence[str] = (),
    progress: Progress | None = None,
    tell: Tell = silent,
) -> list[str]:
    """Fit a method to the queries of tuning data, and write the fitted settings with their provenance to a file.

    There are three steps. Each matching setting in `tries` is set to the value with the lowest loss. The setting
    `weights` is fitted, if the method has it. The `posterior`, which turns scores into probabilities, is fitted to the
    queries in maps with their place and in maps without it.

    Args:
        method: The method.
        data: Names of datasets, at least one.
        output: The YAML file to write.
        tries: Matching settings to try, as "key.path=value,value".
        posterior_only: Whether to keep the matching settings and the weights, and to fit only the posterior.
        data_dir: The `root` of datasets that have one.
        overrides: Settings of the method, the data ("data.KEY") and the engine ("engine.KEY"), as "key.path=value".
        progress: Reports the progress.
        tell: Receives messages.

    Returns:
        The lines of a summary.

    Raises:
        ConfigError: The method has neither weights nor a posterior, `tries` is used with `posterior_only`, a setting to
            try is not a matching setting, or `output` is not named as a YAML file.
        DataError: The queries have no usable answers, or the scores of all places are equal.
    """
    output = Path(output)
    if output.suffix not in SUFFIXES:
        raise ConfigError(f"the output file is {output}, expected a file name that ends in {' or '.join(SUFFIXES)}")
    if not data:
        raise ConfigError("received no tuning data, expected at least one dataset")
    if posterior_only and tries:
        raise ConfigError(
            "received both --try and --posterior-only, expected at most one of them, because --posterior-only changes "
            "no settings"
        )
    tunings = [_describe(one, method, data_dir, overrides, progress, tell) for one in data]
    fields = type(tunings[0].localizer.config).model_fields
    content: dict[str, Any] = {}
    lines, gain = [], {}
    if "weights" in fields and not posterior_only:
        chosen = _try(tunings, tries, tell)
        weights, before, after = _fit(tunings, chosen)
        fitted_weights = {name: float(f"{value:.4g}") for name, value in weights.items()}
        whole = tunings[0].localizer.config.model_dump(mode="json", include=chosen.keys())
        content = {**merge(whole, chosen), "weights": fitted_weights}
        gain["evidence"] = {"before": before, "after": after}
        lines.append(
            f"weights: mean -ln(probability of the query's place) {after:.3f}, {before:.3f} for a uniform distribution"
        )
    elif tries:
        raise ConfigError(
            f"the method {method} has no setting `weights`, which --try needs: use another method, or leave out --try"
        )
    answers = [answer for tuning in tunings for answer in _scored(tuning, content)]
    try:
        fit = fit_posterior(answers)
    except DataError as error:
        raise DataError(f"the method {method} cannot be fitted: {error}") from None
    gain |= {
        "place": {"answers": fit.place_answers, "before": fit.place_nll_before, "after": fit.place_nll_after},
        "here": {"answers": fit.answers, "before": fit.here_nll_before, "after": fit.here_nll_after},
    }
    tuned = tunings[-1].localizer
    plain = tuned.config.model_copy(update={"posterior": None})
    queries = {tuning.name: sum(len(fold.queries) for fold in tuning.dataset.folds()) for tuning in tunings}
    provenance = {
        "method": {"name": method, "localizer": tuned.name, "identity": digest(identity(plain))},
        "data": [
            {"name": tuning.name, "key": tuning.dataset.query_key, "queries": queries[tuning.name]}
            for tuning in tunings
        ],
        "set": list(overrides),
        "try": list(tries),
        "mean_negative_log_likelihood": gain,
        "salframe": installed_version("salframe"),
    }
    content = {**content, "posterior": fit.posterior.model_dump(mode="json"), "provenance": provenance}
    write_text(output, yaml.safe_dump(content, sort_keys=False))
    return [*lines, *_summary(fit)]


def _describe(
    data: str, method: str, data_dir: str | Path | None, overrides: Sequence[str], progress: Progress | None, tell: Tell
) -> TuningData:
    """Return a tuning dataset with all of its frames described."""
    root = data_dir if data_dir and _takes_root(data) else None
    name, dataset, localizer = prepare(data, method, root, [*overrides, HIDE], None, progress, tell)
    if "posterior" not in type(localizer.config).model_fields:
        raise ConfigError(
            f"the method {name} has no setting `posterior`, so the answers have no probabilities to fit: use another "
            "method, such as 'proposed'"
        )
    check_needs(localizer, dataset)
    frames: dict[str, ReferenceFrame | QueryFrame] = {}
    for fold in dataset.folds():
        frames.update({frame.id: frame for frame in fold.references})
        frames.update({frame.id: frame for frame in fold.queries})
    descriptions: dict[str, Description | None] = {}
    cache = Cache()
    for done, (id, frame) in enumerate(frames.items()):
        if progress:
            progress(f"{name} on {data}", done, len(frames))
        try:
            descriptions[id] = describe_frame(localizer, frame, cache, dataset.content_key)[0]
        except FRAME_ERRORS:
            descriptions[id] = None
    return TuningData(data, dataset, localizer, descriptions)


def _takes_root(data: str) -> bool:
    """Return whether a dataset has a `root` setting."""
    if Path(data).is_dir():
        return False
    return "root" in registry().get("dataset", settings("dataset", data)["kind"]).Config.model_fields


def _try(tunings: Sequence[TuningData], tries: Sequence[str], tell: Tell) -> dict[str, Any]:
    """Return the best of the settings to try. Each setting is tried with the best values of the settings before it."""
    best: dict[str, Any] = {}
    min_loss = _fit(tunings, best)[2] if tries else 0.0
    for text in tries:
        path, values = parse_override(text.replace("=", "=[", 1) + "]")
        for value in values:
            changed = merge(best, nest(path, value))
            loss = _fit(tunings, changed)[2]
            tell(
                f"{'.'.join(path)}={value}: mean -ln(probability of the query's place) {loss:.4f}, lowest before: "
                f"{min_loss:.4f}"
            )
            if loss < min_loss:
                best, min_loss = changed, loss
    return best


def _fit(tunings: Sequence[TuningData], changes: Mapping[str, Any]) -> tuple[dict[str, float], float, float]:
    """Fit the weights of a method with changed settings to the queries whose place is in the map. See `fit_weights`."""
    samples: list[tuple[Evidence, str]] = []
    for tuning in tunings:
        for localizer, description, place, here in tuning.iterate_queries(changes, absent=False):
            if here and (evidence := localizer.evidence(description)) is not None:
                samples.append((evidence, place))
    return fit_weights(samples)


def _scored(tuning: TuningData, changes: Mapping[str, Any]) -> Iterator[ScoredAnswer]:
    """Yield the scores and the true place of each answer that ranks places."""
    counts = [count for count in tuning.num_objects.values() if count]
    map_objects = float(np.mean(counts)) if counts else 0.0
    for localizer, description, place, here in tuning.iterate_queries(changes):
        answer = localizer.match(description)
        if answer.places:
            names = [ranked.place for ranked in answer.places]
            scores = np.array([ranked.score for ranked in answer.places], np.float64)
            position = names.index(place) if place in names else None
            objects = localizer.count_objects(description)
            yield ScoredAnswer(scores, position, here, tuning.map_key, objects, map_objects, answer.evidence)


def _summary(fit: Fit) -> list[str]:
    return [
        f"temperature {fit.posterior.temperature:.4g}: mean -ln(probability of the query's place) "
        f"{fit.place_nll_after:.3f}, "
        f"{fit.place_nll_before:.3f} at temperature 1; {fit.place_answers} answers",
        f"out-of-map probability: mean -ln(probability of the true case, in the map or not) {fit.here_nll_after:.3f}, "
        f"{fit.here_nll_before:.3f} with a constant probability; {fit.answers} answers",
    ]
