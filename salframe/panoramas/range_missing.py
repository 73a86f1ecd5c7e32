"""Find undeclared values of range images that mean an unknown range, such as 65535."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from salframe.panoramas.geometry import row_elevation
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_encoding import MILLIMETRE, RangeEncoding
from salframe.panoramas.samples import Frame, load_samples

MIN_SHARE = 0.003
"""Minimum share of the known pixels, by solid angle, that have a value which may mean an unknown range."""
MAX_PIXELS = 0.52
"""Maximum share of all pixels that have such a value. A value that fills more is the background of a drawn image."""
MIN_RATIO = 8.0
"""Minimum ratio of the share of pixels with the value to the share of each neighbouring value. Neighbouring values on a
surface have similar shares."""
NUM_NEIGHBOURS = 8
NEAR = 0.25
"""A value is compared with up to NUM_NEIGHBOURS smaller and as many larger values that occur in the image. Their
relative difference to the value is at most NEAR."""
MIN_OUTSIDE = 2.0
"""Minimum factor by which the value is larger or smaller than the values of all surfaces. It applies to images in which
whole surfaces have a single value."""
MIN_VALUES = 50
"""Minimum number of values that occur. An image with fewer values is drawn, not measured."""
MIN_GAP = 0.02
"""Minimum relative difference between the largest value of an image and the next smaller value. If the difference is
smaller, the largest value is the maximum range of the sensor."""
MIN_JUMP = 0.1
"""Minimum relative difference of two neighbouring pixels that counts as a jump of the range."""
MIN_JUMP_SHARE = 0.9
"""Minimum share of neighbouring pixels with a jump of the range (MIN_JUMP), along the border of the pixels with the
value. Along the border of a real surface, the share is smaller, because the surface touches other surfaces."""
NUM_FRAMES = 6
"""Maximum number of panoramas that are loaded to find values that mean an unknown range."""


def missing_values(steps: np.ndarray, weights: np.ndarray | None = None) -> dict[int, float]:
    """Return the values of a range image that likely mean an unknown range, each with its share of the known pixels.

    Such a value fills many more pixels than the values next to it, and the range jumps almost everywhere around it.

    Args:
        steps: (h, w) values of the file; 0 where the range is unknown.
        weights: (h, w) or (h, 1) solid angle of the pixels; None: equal.
    """
    is_known = steps > 0
    weight = np.broadcast_to(1.0 if weights is None else weights, steps.shape)[is_known]
    count, weight_of = np.bincount(steps[is_known]), np.bincount(steps[is_known], weight)
    values = np.flatnonzero(count)
    if len(values) < MIN_VALUES:
        return {}
    shares = weight_of[values] / weight_of.sum()
    is_background = count[values] > MAX_PIXELS * steps.size
    candidates = {
        int(values[number]): float(shares[number])
        for number in np.flatnonzero((shares >= MIN_SHARE) & ~is_background).tolist()
        if _stands_out(values, shares, number)
    }
    missing = {}
    while candidates:  # pixels without a reading make surfaces look disconnected, so that they are removed one by one
        jumps = {value: _jump_share(steps, value) for value in candidates}
        value = max(jumps, key=lambda value: jumps[value])
        if jumps[value] < MIN_JUMP_SHARE:
            break
        missing[value] = candidates.pop(value)
        steps = np.where(steps == value, 0, steps)
    if candidates:  # whole surfaces have one value, as in z-depth: a surface may be a candidate
        surfaces = np.setdiff1d(values, list(missing))
        nearest, farthest = surfaces[0] / MIN_OUTSIDE, surfaces[-1] * MIN_OUTSIDE
        missing = {value: share for value, share in missing.items() if value < nearest or value > farthest}
    return missing


def _stands_out(values: np.ndarray, shares: np.ndarray, number: int) -> bool:
    """Return whether a value has many more pixels than neighbouring values, and is not the maximum range of a sensor.

    Args:
        values: (V,) values that occur, in ascending order.
        shares: (V,) share of the pixels with each value.
        number: Index of the value.
    """
    value = values[number]
    first, last = np.searchsorted(values, [value * (1 - NEAR), value * (1 + NEAR)])
    below = shares[max(first, number - NUM_NEIGHBOURS) : number]
    above = shares[number + 1 : min(last, number + NUM_NEIGHBOURS + 1)]
    is_limit = number == len(values) - 1 and value - values[number - 1] < MIN_GAP * value
    return not is_limit and bool(shares[number] >= MIN_RATIO * np.r_[below, above].max(initial=0))


def _jump_share(steps: np.ndarray, value: int) -> float:
    """Return the share of neighbouring pixels with a jump of the range, along the border of the pixels with a value."""
    pairs = [(steps[1:], steps[:-1]), (steps[:, 1:], steps[:, :-1])]
    first, second = (np.concatenate([pair[side].ravel() for pair in pairs]).astype(np.int64) for side in (0, 1))
    at_edge = ((first == value) != (second == value)) & (first > 0) & (second > 0)
    first, second = first[at_edge], second[at_edge]
    if not len(first):
        return 0.0
    return float(np.mean(np.abs(first - second) > MIN_JUMP * np.maximum(first, second)))


def missing_note(frames: Sequence[Frame]) -> str | None:
    """Return a one-line warning if a value of the range images seems to mean an unknown range; None if none does.

    A few of the frames are loaded. Panoramas without range and unreadable panoramas are ignored.
    """
    panoramas = [panorama for _, panorama in load_samples(frames, NUM_FRAMES) if panorama.range_m is not None]
    shares: dict[int, list[float]] = {}
    concerned: dict[str, RangeEncoding | None] = {}
    for panorama in panoramas:
        encoding = panorama.range_encoding
        steps = (encoding or RangeEncoding()).panorama_steps(np.asarray(panorama.range_m))
        solid_angle = np.cos(row_elevation(len(steps)))[:, None]
        for value, share in missing_values(steps, solid_angle).items():
            shares.setdefault(value, []).append(share)
            concerned[panorama.id] = encoding
    if not concerned:
        return None
    first, encoding = next(iter(concerned.items()))
    source = f"range image of {first}" if len(panoramas) == 1 else f"range images ({_listed(concerned, panoramas)})"
    return missing_line({value: float(np.median(of)) for value, of in shares.items()}, source, encoding)


def missing_line(shares: Mapping[int, float], source: str, encoding: RangeEncoding | None) -> str:
    """Return the one-line warning on values that likely mean an unknown range.

    Args:
        shares: Share of the pixels with each value.
        source: The range images.
        encoding: Encoding of the files of the range images. None if there are no files: values are then millimetres.
    """
    values = sorted(shares)
    fills = " and ".join(
        f"the value {value if encoding else f'{value * MILLIMETRE:g} m'} fills {shares[value]:.1%}" for value in values
    )
    differs = "differs from the ranges around it, so it likely means"
    if len(values) > 1:
        differs = "these values differ from the ranges around them, so they likely mean"
    likely = f"{fills} of the pixels of the {source} and {differs} an unknown range"
    if encoding is None:
        return f"{likely}: set the range of these pixels to NaN"
    missing = sorted({*encoding.missing, *values})
    options = " ".join(f"--range-missing {value}" for value in missing)
    return f'{likely}: set "range_missing": {missing} in manifest.json (for single images: {options})'


def _listed(concerned: Mapping[str, object], panoramas: Sequence[Panorama]) -> str:
    return f"{len(concerned)} of {len(panoramas)} checked images, such as {next(iter(concerned))}"
