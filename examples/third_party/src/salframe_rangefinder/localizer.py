"""A localizer without stages: places by the spectrum of the ranges around the camera."""

import numpy as np
from pydantic import Field

import salframe


class RangeProfile(salframe.Localizer):
    """Spectrum of the ranges at camera height, which does not depend on the heading. Gives a place and no pose."""

    name = "range-profile"
    version = "1"
    needs = frozenset({"range"})

    class Config(salframe.ComponentConfig):
        frequencies: int = Field(16, ge=1, description="number of frequencies of the spectrum, the lowest first")
        sharpness: float = salframe.match_only(1.0, gt=0, description="decrease of the score with distance, in 1/metre")

    def describe(self, panorama):
        ranges_m = np.nan_to_num(panorama.range_m[len(panorama.range_m) // 2].astype(float))
        return {"spectrum_m": np.abs(np.fft.rfft(ranges_m, norm="forward"))[: self.config.frequencies]}

    def index(self, descriptions, frames):
        self._spectra_m = np.stack([description["spectrum_m"] for description in descriptions])
        self._frames = frames

    def match(self, description):
        if not description["spectrum_m"].any():
            return salframe.Localization((), None, salframe.LocalizationStatus.NO_FEATURES)
        distance_m = np.linalg.norm(self._spectra_m - description["spectrum_m"], axis=1)
        scores = np.exp(-self.config.sharpness * distance_m)
        return salframe.Localization(
            salframe.rank_places(self._frames, scores), None, salframe.LocalizationStatus.NO_POSE
        )
