"""Content of an HTML page that the browser reads on demand: details of queries and reference frames, and their
panoramas."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from salframe.evaluation.report.page import as_json, picture
from salframe.evaluation.tasks.localization.detail import Details, QuerySet
from salframe.framework.errors import FRAME_ERRORS
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import Panorama

THUMBNAIL_PX, THUMBNAIL_QUALITY, FULL_QUALITY = 512, 55, 80
"""Width of a thumbnail, and the quality (0 to 100) of thumbnails and of full panoramas."""
MAX_RANGE_M = 8.0
"""Minimum range of pixels that are drawn in the darkest grey, in the picture of a panorama without colour."""


def make_islands(
    sets: Sequence[tuple[QuerySet, Details]], full: bool, progress: Progress | None = None
) -> Iterator[tuple[str, str]]:
    """Yield pairs of an id and a text: the content of an HTML page that the browser reads on demand, as JSON or a data
    URL.

    In data set s, q{s}-{i} is query i and f{s}-{j} is reference frame j. Their panoramas are pq{s}-{i} and pf{s}-{j}.
    A frame that cannot be read has no panorama.
    """
    total, done = sum(len(query_set.queries) + len(details.frames) for query_set, details in sets), 0
    for s, (query_set, details) in enumerate(sets):
        order = {id: j for j, id in enumerate(details.frames)}
        for i, query in enumerate(details.queries):
            for one in query["arms"].values():
                for reference in one["references"]:
                    reference["frame"] = order.get(reference["frame"], reference["frame"])
            yield f"q{s}-{i}", as_json(query)
        for j, reference_frame in enumerate(details.frames.values()):
            yield f"f{s}-{j}", as_json(reference_frame)
        frames: list[tuple[str, ReferenceFrame | QueryFrame]] = [
            *((f"pq{s}-{i}", frame) for i, (_, frame) in enumerate(query_set.queries)),
            *((f"pf{s}-{j}", details.map_frames[id]) for id, j in order.items()),
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
    """Return a panorama as a data URL; None if it has neither colour nor range.

    The range is drawn where there is no colour. Invalid pixels are grey. The picture is a thumbnail unless `full`.
    """
    import cv2

    if panorama.rgb is not None:
        image = panorama.rgb.copy()
    elif panorama.range_m is not None:
        near = 1 - np.clip(np.nan_to_num(panorama.range_m, nan=MAX_RANGE_M) / MAX_RANGE_M, 0, 1)
        image = np.repeat(np.round(40 + 200 * near).astype(np.uint8)[..., None], 3, 2)
    else:
        return None
    if panorama.valid is not None:
        image[~panorama.valid] = 128
    if full:
        return picture(image, quality=FULL_QUALITY)
    if image.shape[1] > THUMBNAIL_PX:
        image = cv2.resize(image, (THUMBNAIL_PX, THUMBNAIL_PX // 2), interpolation=cv2.INTER_AREA)
    return picture(image, quality=THUMBNAIL_QUALITY)
