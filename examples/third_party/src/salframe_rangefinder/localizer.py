"""A localizer without stages: places by the spectrum of the ranges around the camera, headings by their correlation."""

import numpy as np

import salframe


class RangeProfile(salframe.Localizer):
    """Compares the spectra of the ranges at camera height, which do not depend on the heading.

    The position in the answer is that of the reference frame with the most similar spectrum.
    """

    name = "range-profile"
    version = "2"
    needs = frozenset({"range"})

    class Config(salframe.ComponentConfig):
        frequencies: int = salframe.match_only(16, ge=1, description="number of compared frequencies, lowest first")
        sharpness: float = salframe.match_only(1.0, gt=0, description="decrease of the score with distance, in 1/metre")

    def describe(self, panorama):
        return {"range_m": np.nan_to_num(panorama.range_m[len(panorama.range_m) // 2].astype(float))}

    def index(self, descriptions, frames):
        self._spectra_m = np.fft.rfft([description["range_m"] for description in descriptions], norm="forward")
        self._frames = frames

    def match(self, description):
        if not description["range_m"].any():
            return salframe.Localization((), None, salframe.LocalizationStatus.NO_FEATURES)
        spectrum_m, compared = np.fft.rfft(description["range_m"], norm="forward"), slice(self.config.frequencies)
        distance_m = np.linalg.norm(np.abs(self._spectra_m[:, compared]) - np.abs(spectrum_m[compared]), axis=1)
        scores = np.exp(-self.config.sharpness * distance_m)
        best, width = scores.argmax(), len(description["range_m"])
        turn = np.fft.irfft(
            self._spectra_m[best] * spectrum_m.conj(), width
        ).argmax()  # columns with the best correlation
        T_world_pano = self._frames[best].T_world_pano  # pose of the best reference frame
        T_pano_query = salframe.pose_2d(0, 0, -2 * np.pi * turn / width)
        places = salframe.rank_places(self._frames, scores)
        return salframe.Localization(places, T_world_pano @ T_pano_query, salframe.LocalizationStatus.OK)
