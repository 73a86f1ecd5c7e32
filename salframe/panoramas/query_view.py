"""What queries show of what was taken: a part of the sphere, and objects that are told with errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache, partial
from typing import Any

import numpy as np

from salframe.framework.component import ComponentConfig, added
from salframe.framework.components.identity import settings_identity
from salframe.framework.errors import InputMissing
from salframe.framework.files.hashes import digest
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.object_noise import AnnotationNoise, spoil_annotations
from salframe.panoramas.panorama import Panorama

ASPECT = 3 / 4
"""Height of a rectilinear view over its width."""
LISTED_HEIGHT = 180
"""Rows of `valid` where there is no image that says how many: a degree each."""


class QueryView(ComponentConfig):
    """Base of the Config of data sets whose queries may show less than was taken, or objects that are told with errors.

    Map frames stay as they are. What is stored of a data set depends on none of these settings: it is seen through them
    (`as_query`), as is what `observe` shows.
    """

    query_fov_deg: float = added(
        360.0,
        match_only=True,
        gt=0,
        le=360,
        description="degrees around their heading that queries show, at all elevations",
    )
    query_focal: float | None = added(
        None,
        match_only=True,
        gt=0,
        description="focal length of the one rectilinear view along their heading that queries show, over half its "
        "width: 1, 2, 3 are 90, 53, 37 deg across and, at 4:3, 74, 41, 28 deg from top to bottom; null: panoramas",
    )
    query_noise: AnnotationNoise = added(
        AnnotationNoise(), match_only=True, description="errors in the annotations of queries, not of reference frames"
    )


VIEW_SETTINGS = frozenset(QueryView.model_fields) - {"kind"}
"""Names of the settings: a data set's fingerprint is without them."""


def view_settings(config: ComponentConfig) -> dict[str, Any]:
    """The settings of QueryView that are not the defaults, which show queries as they were taken."""
    if not isinstance(config, QueryView):
        return {}
    return {name: value for name, value in settings_identity(config).items() if name in VIEW_SETTINGS}


def as_query(panorama: Panorama, config: ComponentConfig) -> Panorama:
    """A panorama as queries of a data set show it. Raises InputMissing where errors are set and it has no
    annotations."""
    if not isinstance(config, QueryView):
        return panorama
    if config.query_noise != AnnotationNoise():
        if panorama.annotations is None:
            raise InputMissing(f"{panorama.id} has no annotations, which query_noise puts errors in")
        panorama = spoil_annotations(panorama, config.query_noise, getattr(config, "seed", 0))
    if config.query_fov_deg < 360 or config.query_focal is not None:
        panorama = _narrowed(panorama, config.query_fov_deg, config.query_focal)
    return panorama


def view_queries(folds: Sequence[Fold], config: ComponentConfig, stored_key: str) -> list[Fold]:
    """The folds with queries as settings of QueryView show them. `stored_key`: what caches know frames by that have no
    `content`, as they were taken."""
    view = view_settings(config)

    @cache  # folds share their frames
    def stored(frame: ReferenceFrame) -> ReferenceFrame:
        return replace(frame, content=frame.content or stored_key)

    def seen(query: QueryFrame) -> QueryFrame:
        content = digest([query.content or stored_key, view])
        return QueryFrame(query.id, partial(_load_seen, query, config), content)

    return [Fold(fold.id, tuple(map(stored, fold.references)), tuple(map(seen, fold.queries))) for fold in folds]


def _load_seen(query: QueryFrame, config: ComponentConfig) -> Panorama:
    return as_query(query.load(), config)


def _narrowed(panorama: Panorama, fov_deg: float, focal: float | None) -> Panorama:
    """What a view shows: outside of it nothing is valid, colour is black and range NaN, and there are no objects, of
    those in a list the ones whose middle lies there."""
    annotations = panorama.annotations
    instance_id = None if annotations is None else annotations.instance_id
    images = (panorama.rgb, panorama.range_m, instance_id, panorama.valid)
    height = next((len(image) for image in images if image is not None), LISTED_HEIGHT)
    inside = _seen_pixels(height, fov_deg, focal)
    if annotations is not None and instance_id is not None:
        annotations = replace(annotations, instance_id=np.where(inside, instance_id, np.int32(0)))
    elif annotations is not None and annotations.objects is not None:
        objects = annotations.objects
        annotations = replace(annotations, objects=objects.take(sees(objects.centroid_m, fov_deg, focal)))
    return replace(
        panorama,
        rgb=None if panorama.rgb is None else np.where(inside[..., None], panorama.rgb, np.uint8(0)),
        range_m=None if panorama.range_m is None else np.where(inside, panorama.range_m, np.float32(np.nan)),
        valid=inside if panorama.valid is None else inside & panorama.valid,
        annotations=annotations,
    )


def sees(rays: np.ndarray, fov_deg: float, focal: float | None) -> np.ndarray:
    """(...) bool: which directions (..., 3) in the panorama frame, of any length, a view shows; none that is NaN."""
    forward, left, up = np.moveaxis(rays, -1, 0)
    inside = np.abs(np.arctan2(left, forward)) <= np.radians(fov_deg) / 2
    if focal is not None:
        inside &= (forward > 0) & (focal * np.abs(left) <= forward) & (focal * np.abs(up) <= ASPECT * forward)
    return inside


@lru_cache(maxsize=4)
def _seen_pixels(height: int, fov_deg: float, focal: float | None) -> np.ndarray:
    """(H, 2H) bool: the pixels of a panorama that a view shows; read-only, shared by calls."""
    inside = sees(equirectangular_rays(height), fov_deg, focal)
    inside.flags.writeable = False
    return inside
