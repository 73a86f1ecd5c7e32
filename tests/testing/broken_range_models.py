"""Range models that each break one rule, and the message of the conformance suite about each."""

from __future__ import annotations

import numpy as np

from salframe.panoramas.range_model import RangeModel, from_bright_side


class Ranging(RangeModel):
    """A range model that conforms, and the base class of those that break one rule."""

    name, version = "ranging", "1"

    @from_bright_side
    def estimate(self, panorama):
        return (1 + panorama.rgb.mean(-1) / 64).astype(np.float32)


class Sensing(Ranging):
    """Broken."""

    needs = frozenset({"rgb", "range"})


class Double(Ranging):
    """Broken."""

    def estimate(self, panorama):
        return super().estimate(panorama).astype(float)


class Narrow(Ranging):
    """Broken."""

    def estimate(self, panorama):
        return super().estimate(panorama)[:, ::2]


class Zeroing(Ranging):
    """Broken."""

    def estimate(self, panorama):
        return np.where(panorama.rgb.mean(-1) < 60, np.float32(0), super().estimate(panorama))


class Blinded(Ranging):
    """Broken."""

    def estimate(self, panorama):
        if not panorama.rgb.any():
            raise ValueError("nothing to see")
        return super().estimate(panorama)


class Wavering(Ranging):
    """Broken."""

    def estimate(self, panorama):
        return super().estimate(panorama) * np.float32(np.random.default_rng().uniform(0.9, 1.1))


class Slanted(Ranging):
    """Broken."""

    def estimate(self, panorama):
        range_m = super().estimate(panorama)
        return range_m * np.linspace(1, 1.1, range_m.shape[1], dtype=np.float32)


BROKEN_RANGE_MODELS = [
    (Sensing, r"needs: received \{.*\}, expected one or more of annotations, rgb"),
    (Double, r"estimate of the bedroom: received float64 \(192, 384\), expected float32 \(192, 384\)"),
    (Narrow, r"estimate of the bedroom: received float32 \(192, 192\), expected float32 \(192, 384\)"),
    (Zeroing, r"estimate of the bedroom: received a range of 0\.0 m, expected positive metres, or NaN where unknown"),
    (Blinded, "estimate of a blank panorama: received ValueError: nothing to see"),
    (Wavering, "estimate of the bedroom: received two different answers to the same input"),
    (Slanted, "estimate of the bedroom rolled by 192 columns: received .*% of the ranges changed, expected at most 5%"),
]
