"""Signs that the detector `text` reads, and its time: `python -m training.signs.reading --rooms 12 --seeds 200,201`.

The command renders offices with signs, reads each query with the detector, and compares the strings with the signs that
the rendered panorama shows. The page docs/how-to/text.md reports the results.
"""

from __future__ import annotations

import time
from itertools import pairwise
from typing import Annotated

import numpy as np
import typer
from salframe_text.detector import TextDetector

from salframe.framework.components.presets import configure
from salframe.graphs.detections import unit_vectors
from salframe.graphs.texts import text_key
from salframe.localization.preparing import prepare
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama, split_text

LETTER_SHARE = 0.46
"""Height of the digits of a sign relative to the height of the sign."""
LIMITS_PX = 0.0, 6.0, 9.0, 12.0, 16.0, 24.0, np.inf
"""Limits of the groups of letter heights, in pixels of the panorama. Each group is counted separately."""
MAX_ANGLE = float(np.radians(6))
"""Maximum angle between a sign and a string that was read on it."""


def visible_signs(panorama: Panorama) -> list[tuple[str, np.ndarray, float]]:
    """Return the signs of a rendered panorama: text ("" if unreadable), bearing (3,), and letter height in pixels."""
    annotations = panorama.annotations
    assert annotations is not None
    assert annotations.instance_id is not None
    rays = equirectangular_rays(len(annotations.instance_id))
    signs = []
    for instance in np.unique(annotations.instance_id).tolist():
        name, text = split_text(annotations.labels.get(instance, ""))
        if name == "text":
            mask = annotations.instance_id == instance
            height_px = float(np.median(mask.sum(0)[mask.any(0)]))
            signs.append((text, unit_vectors(rays[mask].mean(0)[None])[0], LETTER_SHARE * height_px))
    return signs


def main(
    rooms: Annotated[int, typer.Option(help="Number of rooms of each office")] = 12,
    seeds: Annotated[str, typer.Option(help="Seeds of the offices, separated by commas")] = "200,201",
    height: Annotated[int, typer.Option(help="Height of the panoramas in pixels")] = 1024,
    lighting: Annotated[str, typer.Option(help="Lighting of the queries: day, evening, dim or other")] = "other",
    queries: Annotated[int, typer.Option(help="Number of queries per room")] = 1,
) -> None:
    """Count the signs in rendered panoramas that are read correctly, by the height of their letters."""
    detector = TextDetector(configure("detector", "text", {}))
    letters_px, is_read, times_ms, cpu_ms, false_strings, num_strings = [], [], [], [], 0, 0
    for seed in seeds.split(","):
        keys = ("style=office", "signs=true", f"rooms={rooms}", f"seed={seed}", f"height={height}")
        keys += (f"lighting={lighting}", f"queries_per_room={queries}")
        _, dataset, _ = prepare("house-12", "proposed", None, [f"data.{key}" for key in keys], None, None, print)
        for query in dataset.folds()[0].queries:
            panorama = query.load()
            start_s, start_cpu_s = time.perf_counter(), time.process_time()
            strings = detector.detect(panorama)
            times_ms.append(1000 * (time.perf_counter() - start_s))
            cpu_ms.append(1000 * (time.process_time() - start_cpu_s))
            signs = visible_signs(panorama)
            bearings = np.array([bearing for _, bearing, _ in signs]).reshape(-1, 3)
            near = strings.bearing @ bearings.T > np.cos(MAX_ANGLE)
            same = np.array([[text_key(a) == text_key(b) for b, *_ in signs] for a in strings.texts], bool)
            right = near & same.reshape(near.shape)
            num_strings += len(strings)
            false_strings += int((~right.any(1)).sum())
            letters_px += [letter_px for *_, letter_px in signs]
            is_read += right.any(0).tolist()
    letters, read = np.array(letters_px), np.array(is_read, bool)
    for low, high in pairwise(LIMITS_PX):
        rows = (letters >= low) & (letters < high)
        print(f"letters of {low:g} to {high:g} px: {read[rows].sum()} of {rows.sum()} signs read correctly")
    print(f"{false_strings} of {num_strings} detected strings are not the text of a sign at that position")
    print(
        f"{np.median(times_ms[1:]):.0f} ms per panorama of {height} rows, with {np.median(cpu_ms[1:]):.0f} ms of "
        f"processor time (medians of {len(times_ms) - 1})"
    )


if __name__ == "__main__":
    typer.run(main)
