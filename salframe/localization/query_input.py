"""Convert the input of `LocalizationMap.localize` to a frame whose panorama is loaded."""

from __future__ import annotations

import numpy as np

from salframe.framework.errors import DataError
from salframe.localization.describing import check_parts, suggest_components
from salframe.localization.localizer import Localizer
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.panorama import UNNAMED_ID, Annotations, Panorama


def query_frame(
    localizer: Localizer,
    query: ReferenceFrame | QueryFrame | Panorama | None,
    rgb: np.ndarray | None = None,
    range_m: np.ndarray | None = None,
    annotations: Annotations | None = None,
) -> QueryFrame:
    """Return a query without earlier views, with its panorama in memory. Arguments and errors are those of
    `LocalizationMap.localize`."""
    if query is None:
        query = Panorama(UNNAMED_ID, rgb, range_m, annotations=annotations)
    elif not isinstance(query, ReferenceFrame | QueryFrame | Panorama):
        raise DataError(
            f"the query is {type(query).__name__}, expected a frame, a Panorama, or arrays as rgb=, "
            "range_m= and annotations=: read files with salframe.read_panorama"
        )
    elif any(image is not None for image in (rgb, range_m, annotations)):
        raise DataError(
            f"received both the query {query.id} and images (rgb, range_m or annotations), expected only one of them"
        )
    if isinstance(query, Panorama):
        panorama = query
        check_parts(localizer, panorama, lambda: suggest_components(localizer.config, panorama.provides))
    else:
        panorama = query.load()
    return QueryFrame(query.id, lambda: panorama)
