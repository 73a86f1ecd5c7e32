"""Accuracy with and without signs: `python -m training.signs.measure house-106 --seeds 200,201`.

The data is a preset of the dataset `house`. The command localizes the same queries in buildings without signs, and with
signs of which some are unreadable or wrong. It prints the accuracy in twin rooms and in all rooms, and the p-values of
paired tests. The page docs/how-to/text.md reports the results.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from salframe_house.rendering import buildings_of

from salframe.evaluation.statistics import estimate_proportion, paired_test
from salframe.framework.files.cache import Cache
from salframe.localization.map import LocalizationMap
from salframe.localization.preparing import prepare
from salframe.panoramas.opening import reference_frames

EVIDENCE = "likelihood", "outline", "panorama", "labels"
"""Evidence of `proposed` without texts."""
REFERENCES = "without signs", "signs, texts not compared", "shuffled"
"""Conditions that all others are compared with by a paired test."""


@dataclass(frozen=True)
class SignCondition:
    """Settings of one measurement.

    Attributes:
        signs: Whether the building has signs.
        texts: Whether the evidence `text` compares the strings on the signs.
        unreadable: Share of unreadable signs of the queries.
        wrong: Share of signs of the queries that have the number of another room.
    """

    signs: bool = True
    texts: bool = True
    unreadable: float = 0.0
    wrong: float = 0.0

    @property
    def settings(self) -> list[str]:
        """Settings of the data and of `proposed`."""
        evidence = [*EVIDENCE, "text"] if self.texts else EVIDENCE
        changes = [f"data.signs_unreadable={self.unreadable}", f"data.signs_wrong={self.wrong}"]
        return [f"proposed.evidence=[{','.join(evidence)}]", f"data.signs={str(self.signs).lower()}", *changes]


CONDITIONS = {
    "without signs": SignCondition(signs=False, texts=False),
    "signs, texts not compared": SignCondition(texts=False),
    "all signs correct": SignCondition(),
    "shuffled": SignCondition(unreadable=0.3, wrong=0.7),
    "30 % unreadable, 5 % wrong": SignCondition(unreadable=0.3, wrong=0.05),
    "all signs wrong": SignCondition(wrong=1.0),
}
"""The measured conditions. In "shuffled", all readable signs of the queries have the number of another room."""


def localize_all(data: str, settings: Sequence[str]) -> tuple[np.ndarray, list[str], np.ndarray]:
    """Localize all queries of a generated building.

    Returns:
        Whether the first place of each answer is the true place, (Q,) bool. The true room of each query; two twin rooms
        have one common name. Whether the room is a twin, (Q,) bool.
    """
    _, dataset, localizer = prepare(data, "proposed", None, settings, None, None, print)
    built = LocalizationMap.build(
        localizer, reference_frames(dataset), Cache(), dataset.content_key, floors=dataset.floors(), calibrate=False
    )
    twins = {room.id: room.twin for room in buildings_of(dataset.config)[0].rooms if room.twin is not None}
    right, rooms, is_twin = [], [], []
    for query in dataset.folds()[0].queries:
        place = dataset.truth(query.id).place
        answer = built.localize(query, warn=lambda line: None)
        right.append(bool(answer.places) and answer.places[0].place == place)
        rooms.append(twins.get(place, place))
        is_twin.append(place in twins)
    return np.array(right), rooms, np.array(is_twin)


def main(
    data: Annotated[str, typer.Argument(help="Preset of the dataset house")],
    seeds: Annotated[str, typer.Option(help="Seeds of the buildings, separated by commas")] = "200,201",
    noise: Annotated[
        str, typer.Option(help="Simulated errors of the detector `annotations`: panoseg, segments or none")
    ] = "panoseg",
    fov: Annotated[float, typer.Option(help="Horizontal field of view of the queries in degrees")] = 360.0,
) -> None:
    """Compare localization with and without signs."""
    right: dict[str, np.ndarray] = {}
    for name, condition in CONDITIONS.items():
        parts, clusters, twins = [], [], []
        for seed in seeds.split(","):
            building = ["data.rgb=false", f"data.seed={seed}", f"data.query_fov_deg={fov}"]
            settings = [*building, f"proposed.detector.noise={noise}", *condition.settings]
            correct, rooms, is_twin = localize_all(data, settings)
            parts.append(correct)
            clusters += [f"{seed}/{room}" for room in rooms]
            twins.append(is_twin)
        right[name], chosen = np.concatenate(parts), np.concatenate(twins)
        for kind, rows in (("twin rooms", np.flatnonzero(chosen)), ("all rooms", np.arange(len(chosen)))):
            if not len(rows):
                continue
            groups = [clusters[row] for row in rows]
            share = estimate_proportion(right[name][rows], groups)
            tests = [
                f"p-value against {other}: {paired_test(right[name][rows], right[other][rows], groups):.2g}"
                for other in REFERENCES
                if other in right and other != name
            ]
            print(
                f"{name}, {kind}: {right[name][rows].sum()} of {len(rows)}, {share.value:.1%} "
                f"({share.low:.1%} to {share.high:.1%})",
                *tests,
                sep="; ",
                flush=True,
            )


if __name__ == "__main__":
    typer.run(main)
