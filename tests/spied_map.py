"""A map whose localizer notes which frames it has indexed at each match."""

from __future__ import annotations

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.localization.answers import Localization
from salframe.localization.hidden_frames import FrameAnswers
from salframe.localization.localizer import Localizer, posterior_slot
from salframe.localization.map import LocalizationMap
from salframe.localization.posterior import Head, Posterior
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d

HEAD = Head(absent_mean=2.0, absent_deviation=1.0, bias=-2.0, slope=2.0, accuracy=0.75, other_score=0.0)
POSTERIOR = Posterior(temperature=1.0, head=HEAD, query_distance_m=1.0)


class Spy(Localizer):
    """Scores a place by the similarity of the numbers of its frames, and notes what it has indexed at each match."""

    name = "spy"
    version = "1"
    needs = frozenset()

    class Config(ComponentConfig):
        posterior: posterior_slot()  # type: ignore[valid-type]

    def __init__(self, config=None):
        super().__init__(config)
        self.matches: list[tuple[float, list[str]]] = []

    def describe(self, panorama):
        raise AssertionError("the map is made from descriptions, so nothing is described")

    def index(self, descriptions, frames):
        self.frames, self.values = frames, np.array([float(d["value"][0]) for d in descriptions])

    def match(self, description):
        value = float(description["value"][0])
        self.matches.append((value, [frame.id for frame in self.frames]))
        places = rank_places(self.frames, -np.abs(self.values - value))
        return Localization(places, None, "no-pose")


def spied_map(frames_of, calibrate=True, changes=None):
    """A map of places with these numbers of scene frames, and a doorway. Frame f of place p has the value 10 p + f and
    stands at (10 p + f, 0)."""
    frames, descriptions = [], []
    for place, count in enumerate(frames_of):
        for number in range(count):
            value = 10.0 * place + number
            frames.append(ReferenceFrame(f"{place}-{number}", f"place-{place}", pose_2d(value, 0, 0)))
            descriptions.append({"value": np.array([value])})
    frames.append(ReferenceFrame("door", "door", pose_2d(5.0, 0, 0), FrameKind.TRANSITION))
    descriptions.append({"value": np.array([-500.0])})
    settings = {**POSTERIOR.model_dump(), "max_out_of_map_probability": 1.0, **(changes or {})}
    localizer = Spy(Spy.Config(posterior=settings))
    return LocalizationMap.from_descriptions(localizer, descriptions, frames, calibrate=calibrate)


def drawn(count, seed, mean, deviation, accuracy, distance_m=1.0, places=50):
    """Answers whose contrasts are drawn from the model of the head, with its slope of 2."""
    rng = np.random.default_rng(seed)
    right = rng.uniform(size=count) < accuracy
    z = np.concatenate([rng.standard_normal(count) + 2 * right, rng.standard_normal(count)])
    is_absent = np.repeat([False, True], count)
    distance = np.where(is_absent, np.nan, distance_m)
    right = np.concatenate([right, np.zeros(count, bool)])
    place = np.tile(np.arange(count) % places, 2)
    return FrameAnswers(mean + deviation * z, np.zeros(2 * count, int), right, is_absent, distance, place)
