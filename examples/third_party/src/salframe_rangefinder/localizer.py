"""A localizer in one piece: places by the spectrum of the ranges around the camera."""

import numpy as np
from pydantic import Field

import salframe


class RangeProfile(salframe.Localizer):
    """The ranges at the height of the camera by their spectrum, which no turn changes; gives a place and no pose."""

    name = "range-profile"
    version = "1"
    needs = frozenset({"range"})

    class Config(salframe.ComponentConfig):
        frequencies: int = Field(16, ge=1, description="lowest frequencies of the spectrum that are kept")
        sharpness: float = salframe.match_only(
            1.0, gt=0, description="how fast the score falls with the distance, 1/metre"
        )

    def describe(self, panorama):
        around_m = np.nan_to_num(panorama.range_m[len(panorama.range_m) // 2].astype(float))
        return {"spectrum_m": np.abs(np.fft.rfft(around_m, norm="forward"))[: self.config.frequencies]}

    def index(self, descriptions, frames):
        self._spectra_m = np.stack([description["spectrum_m"] for description in descriptions])
        self._map_frames = frames

    def match(self, description):
        if not description["spectrum_m"].any():
            return salframe.Localization((), None, salframe.LocalizationStatus.NO_FEATURES)
        distance_m = np.linalg.norm(self._spectra_m - description["spectrum_m"], axis=1)
        scores = np.exp(-self.config.sharpness * distance_m)
        return salframe.Localization(
            salframe.rank_places(self._map_frames, scores), None, salframe.LocalizationStatus.NO_POSE
        )
