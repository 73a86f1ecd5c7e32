"""Objects of other rooms in queries: `python -m training.places.objects_beyond --seeds 100,101,102,103`.

A camera also shows objects of other rooms, through doorways. The command removes exactly these objects from the queries
of rendered offices, by their true positions, and compares the probability of the true room with the probability for all
objects, and with the probability after the same number of random objects was removed. The page
docs/explanation/method-parts.md reports the results.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from salframe.evaluation.statistics import estimate_mean
from salframe.framework.errors import SalframeError
from salframe.graphs.detections import Detections
from salframe.localization.answers import Localization
from salframe.localization.map import LocalizationMap
from salframe.localization.posterior import shares
from salframe.localization.preparing import prepare
from salframe.panoramas.floors import Regions
from salframe.panoramas.geometry import transform_points
from salframe.panoramas.opening import reference_frames

MAX_LOSS = 10.0
"""Loss in nats of an answer that does not contain the true room."""


def is_beyond(detections: Detections, T_world_pano: np.ndarray, place: str, regions: Regions) -> np.ndarray:
    """Return whether each detection (n,) lies in another room than `place`. Detections without range do not."""
    is_other = np.zeros(len(detections.labels), bool)
    ranged = np.flatnonzero(np.isfinite(detections.centroid_m).all(1))
    world_m = transform_points(T_world_pano, detections.centroid_m[ranged])
    numbers = regions.at(world_m[:, :2], np.full(len(ranged), T_world_pano[2, 3]))
    is_other[ranged] = [number >= 0 and regions.places[number] != place for number in numbers]
    return is_other


def loss(answer: Localization, place: str, temperature: float) -> float:
    """Return the negative logarithm of the share of the true room, at most MAX_LOSS nats."""
    names = [ranked.place for ranked in answer.places]
    if place not in names:
        return MAX_LOSS
    share = shares(np.array([ranked.score for ranked in answer.places]), temperature)[names.index(place)]
    return float(min(-np.log(max(share, 1e-300)), MAX_LOSS))


def main(
    seeds: Annotated[str, typer.Option(help="Seeds of the offices, separated by commas")],
    noise: Annotated[str, typer.Option(help="Errors of the annotations: panoseg, segments or none")] = "panoseg",
) -> None:
    """Measure the effect of objects of other rooms on the probability of the true room."""
    rows: list[tuple[float, float, float]] = []
    rooms: list[str] = []
    num_beyond = num_objects = 0
    rng = np.random.default_rng(0)
    try:
        for seed in seeds.split(","):
            settings = [f"data.seed={seed}", "data.rgb=false", f"detector.noise={noise}"]
            _, dataset, localizer = prepare("house-42", "proposed", None, settings, None, None, print)
            built = LocalizationMap.build(localizer, reference_frames(dataset), floors=dataset.floors())
            regions = Regions(dataset.floors())
            for query in dataset.folds()[0].queries:
                truth, panorama = dataset.truth(query.id), query.load()
                detections = localizer.detector.detect(panorama)
                beyond = is_beyond(detections, truth.T_world_pano, truth.place, regions)
                num_beyond, num_objects = num_beyond + beyond.sum(), num_objects + len(beyond)
                if beyond.all() or not beyond.any():
                    continue
                drawn = rng.permutation(beyond)
                losses = [
                    loss(
                        built.answer(localizer.describe_objects(detections.take(np.flatnonzero(shown)), panorama)),
                        truth.place,
                        localizer.posterior.temperature,
                    )
                    for shown in (np.ones(len(beyond), bool), ~beyond, ~drawn)
                ]
                rows.append((losses[0], losses[1], losses[2]))
                rooms.append(f"{seed}/{truth.place}")
    except SalframeError as error:
        raise SystemExit(f"error: {error}") from None
    table = np.array(rows)
    print(f"{num_beyond} of {num_objects} objects lie in other rooms; {len(rows)} queries show such objects")
    for name, column in zip(
        ("all objects", "without those of other rooms", "without random objects"), table.T, strict=True
    ):
        print(f"{name}: mean -ln(probability of the true room) {column.mean():.3f}")
    change = estimate_mean(table[:, 1] - table[:, 0], rooms, 0)
    print(f"change without those of other rooms: {change.value:+.3f} ({change.low:+.3f} to {change.high:+.3f})")


if __name__ == "__main__":
    typer.run(main)
