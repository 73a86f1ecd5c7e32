"""A localizer for tests that ranks places by their names, whatever the query."""

from __future__ import annotations

import numpy as np

import salframe
from salframe.localization.answers import ranked_places


class Alphabet(salframe.Localizer):
    """Ranks places in the order of their names. The score of the n-th place is -n."""

    name = "alphabet"
    version = "1"
    needs = frozenset({"rgb"})

    def describe(self, panorama):
        return {"mean": panorama.rgb.mean((0, 1))}

    def index(self, descriptions, frames):
        self._frames = {frame.place: frame.id for frame in sorted(frames, key=lambda frame: frame.id, reverse=True)}

    def match(self, description):
        places = sorted(self._frames)
        ranked = ranked_places(
            [self._frames[place] for place in places], places, [-float(n) for n in range(len(places))]
        )
        return salframe.Localization(ranked, None, salframe.LocalizationStatus.NO_POSE)

    def join(self, descriptions, T_last_view, odometry):
        return {"mean": np.mean([description["mean"] for description in descriptions], 0)}


@salframe.hookimpl
def salframe_provides():
    return [Alphabet]
