"""Queries that show only a part of the sphere, or whose images or annotations have simulated errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache, partial
from typing import Any, Literal

import numpy as np

from salframe.framework.component import ComponentConfig, added
from salframe.framework.components.identity import settings_identity
from salframe.framework.errors import DataError, InputMissing
from salframe.framework.files.hashes import digest
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.object_noise import AnnotationNoise, spoil_annotations
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_image import QueryImage, change_image
from salframe.panoramas.query_motion import OdometryErrors, measured_motion, odometry_seed, turned_query

ASPECT = 3 / 4
"""Ratio of height to width of a rectilinear view."""
DEFAULT_HEIGHT = 180
"""Number of rows of `valid` for panoramas without images: one row per degree."""


class QueryView(ComponentConfig):
    """Base of the Config of datasets whose queries may show a part of the sphere, or have changed images or errors in
    the annotations.

    Reference frames do not change. The stored panoramas of a dataset do not depend on these settings: `as_query`
    applies them to the queries when they are loaded, and to the panoramas of `observe`.
    """

    query_fov_deg: float = added(
        360.0,
        match_only=True,
        gt=0,
        le=360,
        description="horizontal field of view (degrees) of queries, centred on the forward direction of the camera. "
        "360: queries are whole panoramas. The vertical field of view is 180 degrees for all values",
    )
    query_focal: float | None = added(
        None,
        match_only=True,
        gt=0,
        description="focal length of queries that are perspective images with the aspect ratio 4:3, in units of half "
        "the image width. 1: field of view of 90 x 74 deg; 2: 53 x 41 deg; 3: 37 x 28 deg; null: queries are panoramas",
    )
    query_noise: AnnotationNoise = added(
        AnnotationNoise(),
        match_only=True,
        description="simulated errors in the annotations of queries; reference frames have no errors",
    )
    query_image: QueryImage = added(
        QueryImage(),
        match_only=True,
        description="changes of the colour images of queries; the images of reference frames do not change",
    )
    query_views: int = added(
        1,
        match_only=True,
        ge=1,
        le=100,
        description="number of views (images) of each query. Values over 1 simulate a moving camera, see "
        "`query_motion`; 1: no simulation, each query has the views that the dataset contains (usually one)",
    )
    query_motion: Literal["turned", "driven"] = added(
        "turned",
        match_only=True,
        description="motion of the camera between the views of a query, if `query_views` is over 1. turned: the "
        "camera turns to the left without moving, by 60 % of the field of view per view; driven: the camera moves "
        "along a path, which only these datasets support: house, matterport-annotations, and folders whose manifest "
        "contains sequences (panoramas in the order in which they were taken)",
    )
    query_odometry: OdometryErrors = added(
        OdometryErrors(),
        match_only=True,
        description="simulated errors of the motion that odometry measures between the views of a query",
    )
    query_errors: Literal["per-query", "per-view"] = added(
        "per-query",
        match_only=True,
        description="how the simulated errors of annotated objects (`query_noise`, and `noise` of the detector "
        "`annotations`) differ between the views of a query. per-query: an object has the same errors in all views; "
        "per-view: an object has other errors in each view",
    )


MOTION_SETTINGS = frozenset({"query_views", "query_motion", "query_odometry"})
"""Names of the settings that affect only queries of several views."""
VIEW_SETTINGS = frozenset(QueryView.model_fields) - {"kind"}
"""Names of the settings of QueryView, which change queries. The fingerprint of a dataset does not depend on them."""


def view_settings(config: ComponentConfig) -> dict[str, Any]:
    """Return the settings of QueryView that are not the defaults. The defaults do not change queries."""
    if not isinstance(config, QueryView):
        return {}
    return {name: value for name, value in settings_identity(config).items() if name in VIEW_SETTINGS}


def as_query(panorama: Panorama, config: ComponentConfig) -> Panorama:
    """Return a panorama with the settings of QueryView applied: the field of view, errors in annotations, and changes
    of the image.

    Raises:
        InputMissing: Errors in the annotations are set, and the panorama has no annotations; or changes of the image
            are set, and the panorama has no colour.
    """
    if not isinstance(config, QueryView):
        return panorama
    if config.query_image != QueryImage():
        if panorama.rgb is None:
            raise InputMissing(
                f"the query {panorama.id} has no colour image, which the setting query_image needs: leave out "
                "query_image, or use data with colour images"
            )
        panorama = replace(panorama, rgb=change_image(panorama.rgb, config.query_image))
    if config.query_noise != AnnotationNoise():
        if panorama.annotations is None:
            raise InputMissing(
                f"the query {panorama.id} has no annotations, which the setting query_noise needs: leave out "
                "query_noise, or use data with annotations"
            )
        panorama = spoil_annotations(panorama, config.query_noise, getattr(config, "seed", 0))
    if config.query_fov_deg < 360 or config.query_focal is not None:
        panorama = _crop(panorama, config.query_fov_deg, config.query_focal)
    return panorama


def view_queries(folds: Sequence[Fold], config: ComponentConfig, stored_key: str) -> list[Fold]:
    """Return the folds with the settings of QueryView applied to the queries.

    Args:
        folds: The folds.
        config: Settings of the dataset.
        stored_key: Cache key of unchanged frames that have no `content`.
    """
    settings = {name: value for name, value in view_settings(config).items() if name not in MOTION_SETTINGS}

    @cache  # folds share their frames
    def with_key(frame: ReferenceFrame) -> ReferenceFrame:
        return replace(frame, content=frame.content or stored_key)

    def with_view(query: QueryFrame) -> QueryFrame:
        query = _with_motion(query, config, query.content or stored_key)
        *earlier, last = (
            QueryFrame(
                view.id, partial(_load_view, view, config, query.id), digest([view.content or stored_key, settings])
            )
            for view in query.views
        )
        return replace(last, earlier=tuple(earlier), T_last_view=query.T_last_view)

    return [Fold(fold.id, tuple(map(with_key, fold.references)), tuple(map(with_view, fold.queries))) for fold in folds]


def _with_motion(query: QueryFrame, config: Any, content: str) -> QueryFrame:
    """Return a query with the number of views, the motion and the odometry errors that the settings state.

    Raises:
        DataError: The motion is "turned", and the query already has several views in the data or is a whole panorama.
            Or the motion is "driven", and the data have no other views near the query.
    """
    if config.query_views == 1:
        return query
    if config.query_motion == "driven":
        if not query.earlier and query.T_last_view is None:
            raise DataError(
                f"the setting query_motion=driven needs other views near the query {query.id}, which the dataset "
                f"{config.kind} does not have: set query_motion=turned"
            )
    elif query.earlier:
        raise DataError(
            f"the query {query.id} already has {len(query.views)} views in the data, so query_views="
            f"{config.query_views} cannot add views to it: set query_views=1, which adds none"
        )
    else:
        fov_deg = config.query_fov_deg
        if config.query_focal is not None:
            fov_deg = min(fov_deg, 2 * np.degrees(np.arctan(1 / config.query_focal)))
        if fov_deg >= 360:
            raise DataError(
                f"the setting query_views is {config.query_views}, but the queries are whole panoramas, expected a "
                "narrower field of view: set query_fov_deg, such as query_fov_deg=90"
            )
        query = turned_query(query, config.query_views, fov_deg, content)
    if query.T_last_view is None:
        return query
    seed = odometry_seed(query, getattr(config, "seed", 0))
    return replace(query, T_last_view=measured_motion(query.T_last_view, config.query_odometry, seed))


def _load_view(view: QueryFrame, config: Any, query_id: str) -> Panorama:
    """Return the panorama of a view of a query, with the settings of QueryView applied."""
    panorama = view.load()
    if config.query_errors == "per-query" and view.id != query_id and panorama.annotations is not None:
        panorama = replace(panorama, annotations=replace(panorama.annotations, error_id=query_id))
    return as_query(panorama, config)


def _crop(panorama: Panorama, fov_deg: float, focal: float | None) -> Panorama:
    """Return the part of a panorama inside a view.

    Outside the view, pixels are not valid, colour is black, range is NaN, and there are no objects. An object of a list
    is removed if its centroid is outside the view.
    """
    annotations = panorama.annotations
    instance_id = None if annotations is None else annotations.instance_id
    images = (panorama.rgb, panorama.range_m, instance_id, panorama.valid)
    height = next((len(image) for image in images if image is not None), DEFAULT_HEIGHT)
    inside = _visible_pixels(height, fov_deg, focal)
    if annotations is not None and instance_id is not None:
        annotations = replace(annotations, instance_id=np.where(inside, instance_id, np.int32(0)))
    elif annotations is not None and annotations.objects is not None:
        objects = annotations.objects
        annotations = replace(annotations, objects=objects.take(is_in_view(objects.centroid_m, fov_deg, focal)))
    return replace(
        panorama,
        rgb=None if panorama.rgb is None else np.where(inside[..., None], panorama.rgb, np.uint8(0)),
        range_m=None if panorama.range_m is None else np.where(inside, panorama.range_m, np.float32(np.nan)),
        valid=inside if panorama.valid is None else inside & panorama.valid,
        annotations=annotations,
    )


def is_in_view(rays: np.ndarray, fov_deg: float, focal: float | None) -> np.ndarray:
    """Return whether a view shows each of some directions, (...) bool; false where a direction is NaN.

    Args:
        rays: (..., 3) directions of any length in the panorama frame.
        fov_deg: Horizontal field of view in degrees, centred on +x.
        focal: Focal length of a rectilinear view, relative to half its width; None: the view is a part of the panorama
            with all elevations.
    """
    forward, left, up = np.moveaxis(rays, -1, 0)
    inside = np.abs(np.arctan2(left, forward)) <= np.radians(fov_deg) / 2
    if focal is not None:
        inside &= (forward > 0) & (focal * np.abs(left) <= forward) & (focal * np.abs(up) <= ASPECT * forward)
    return inside


@lru_cache(maxsize=4)
def _visible_pixels(height: int, fov_deg: float, focal: float | None) -> np.ndarray:
    """Return whether a view shows each pixel of a panorama, (H, 2H) bool; read-only, shared between calls."""
    inside = is_in_view(equirectangular_rays(height), fov_deg, focal)
    inside.flags.writeable = False
    return inside
