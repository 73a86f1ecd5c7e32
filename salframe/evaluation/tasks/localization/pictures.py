"""The islands of a page: what is read of a query or a map frame when somebody looks at it, and their panoramas."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from salframe.evaluation.report.page import as_json, picture
from salframe.evaluation.tasks.localization.detail import Details, QuerySet
from salframe.framework.errors import FRAME_ERRORS
from salframe.panoramas.frames import MapFrame, QueryFrame
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import Panorama

THUMBNAIL_PX, THUMBNAIL_QUALITY, WHOLE_QUALITY = 512, 55, 80
"""Columns of a thumbnail, and how well it and whole panoramas are kept, of 100."""
FARTHEST_M = 8.0
"""What lies so far away is black in the picture of a panorama without colour."""


def make_islands(
    sets: Sequence[tuple[QuerySet, Details]], full: bool, progress: Progress | None = None
) -> Iterator[tuple[str, str]]:
    """Ids and texts: of set s, q{s}-{i} is query i and f{s}-{j} map frame j, their panoramas pq and pf likewise; where
    a frame cannot be read it has none."""
    total, done = sum(len(asked.queries) + len(found.frames) for asked, found in sets), 0
    for s, (asked, found) in enumerate(sets):
        order = {id: j for j, id in enumerate(found.frames)}
        for i, query in enumerate(found.queries):
            for one in query["arms"].values():
                for reference in one["references"]:
                    reference["frame"] = order.get(reference["frame"], reference["frame"])
            yield f"q{s}-{i}", as_json(query)
        for j, known in enumerate(found.frames.values()):
            yield f"f{s}-{j}", as_json(known)
        frames: list[tuple[str, MapFrame | QueryFrame]] = [
            *((f"pq{s}-{i}", frame) for i, (_, frame) in enumerate(asked.queries)),
            *((f"pf{s}-{j}", found.map_frames[id]) for id, j in order.items()),
        ]
        for id, frame in frames:
            if progress:
                progress("pictures", done, total)
            done += 1
            try:
                url = draw_panorama(frame.load(), full)
            except FRAME_ERRORS:
                continue
            if url is not None:
                yield id, url
    if progress:
        progress("pictures", total, total)


def draw_panorama(panorama: Panorama, full: bool) -> str | None:
    """A panorama as a data URL, by its range where it has no colour, None without both; what was not seen is grey.

    A thumbnail unless `full`.
    """
    import cv2

    if panorama.rgb is not None:
        image = panorama.rgb.copy()
    elif panorama.range_m is not None:
        near = 1 - np.clip(np.nan_to_num(panorama.range_m, nan=FARTHEST_M) / FARTHEST_M, 0, 1)
        image = np.repeat(np.round(40 + 200 * near).astype(np.uint8)[..., None], 3, 2)
    else:
        return None
    if panorama.valid is not None:
        image[~panorama.valid] = 128
    if full:
        return picture(image, quality=WHOLE_QUALITY)
    if image.shape[1] > THUMBNAIL_PX:
        image = cv2.resize(image, (THUMBNAIL_PX, THUMBNAIL_PX // 2), interpolation=cv2.INTER_AREA)
    return picture(image, quality=THUMBNAIL_QUALITY)
