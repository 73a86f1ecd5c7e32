"""Evidence for a place: the spectrum of the ranges around the camera."""

import numpy as np

import salframe

FREQUENCIES, MAX_DIFFERENCE_M = 16, 2.0


class RangeSpectrum(salframe.EvidenceModel):
    """Similarity of the ranges at camera height, independent of the heading, in the column `range_spectrum`."""

    name = "range-spectrum"
    version = "1"
    columns = (
        salframe.EvidenceColumn(
            "range_spectrum",
            "negative difference (m) between the spectra of the query and of the most similar panorama of the place",
            weight=1.0,
        ),
    )
    arrays = ("range_spectrum_m",)
    uses = frozenset({"range"})

    def describe(self, panorama, description):
        if panorama.range_m is None:
            return {}
        ranges_m = np.nan_to_num(panorama.range_m[len(panorama.range_m) // 2].astype(float))
        return {"range_spectrum_m": np.abs(np.fft.rfft(ranges_m, norm="forward"))[:FREQUENCIES]}

    def index(self, descriptions, places, T_world_pano):
        unknown = np.full(FREQUENCIES, np.nan)
        self._spectra_m = np.stack([description.get("range_spectrum_m", unknown) for description in descriptions])
        self._places = places

    def score(self, description, hypotheses):
        if "range_spectrum_m" not in description:
            return {"range_spectrum": np.zeros(len(hypotheses))}
        difference_m = np.linalg.norm(self._spectra_m - description["range_spectrum_m"], axis=1)
        similarity = self._places.max_of_frames(-np.fmin(difference_m, MAX_DIFFERENCE_M))  # fmin ignores NaN
        return {"range_spectrum": similarity[hypotheses.place]}
