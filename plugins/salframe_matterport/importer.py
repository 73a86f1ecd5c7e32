"""`matterport3d`: a building of the Matterport3D release, for the folder format."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError
from salframe.panoramas.house_file import HouseFile, read_house
from salframe.panoramas.importer import Importer, PanoramaRecord, PlaceSource, Recording
from salframe.panoramas.panorama import Annotations, Panorama
from salframe_matterport.objects import label_pixels, labels
from salframe_matterport.release import Color, Viewpoint, cameras_path, find_buildings, house_path, read_viewpoints


class Matterport3DImporter(Importer):
    """A building of the Matterport3D release: the images of each viewpoint, stitched to one RGB-D panorama.

    The range comes from the 18 depth images of the viewpoint. The colour comes from the six skybox images or from the
    18 colour images (setting `color`).

    The objects of the .house file are the annotations, and its regions are the places. Viewpoints outside all regions
    are left out.
    """

    name = "matterport3d"
    version = "1"

    class Config(ComponentConfig):
        scan: str | None = Field(
            None, description="id of the building to import; null: the building in the folder, if there is only one"
        )
        color: Color = Field(
            "skybox",
            description="source images of the colour of a panorama. skybox: the six skybox images, which have even "
            "exposure; pictures: the 18 colour images that belong to the depth images",
        )
        height: int = Field(512, ge=64, description="height of a panorama in pixels; its width is twice the height")

    def read(self, source: Path) -> Recording:
        buildings = find_buildings(source)
        scan = self.config.scan or next(iter(buildings))
        if scan not in buildings or (self.config.scan is None and len(buildings) > 1):
            received = "no scan" if self.config.scan is None else f"the scan {scan}"
            raise DataError(
                f"received {received} for {source}: set scan to the id of one building: {', '.join(buildings)}"
            )
        house, viewpoints = read_house(house_path(buildings[scan])), read_viewpoints(buildings[scan])
        regions = {name: panorama.region for name, panorama in house.panoramas.items()}
        records = tuple(
            self._record(viewpoint, house, region)
            for name, viewpoint in viewpoints.items()
            if (region := regions.get(name)) is not None
        )
        num_outside = len(viewpoints) - len(records)
        note = f"{num_outside} of {len(viewpoints)} viewpoints are left out, because they are in no region"
        objects = labels(house.objects)
        columns: dict[str, list[Any]] = {"instance_id": list(objects), "label": list(objects.values())}
        return Recording(records, objects=columns if objects else None, notes=(note,) if num_outside else ())

    def _record(self, viewpoint: Viewpoint, house: HouseFile, region: int) -> PanoramaRecord:
        sources = cameras_path(viewpoint.folder), house_path(viewpoint.folder), *viewpoint.files(self.config.color)
        return PanoramaRecord(
            viewpoint.name,
            partial(_stitch, viewpoint, house, self.config.height, self.config.color),
            parts=frozenset({"rgb", "range", "valid", *(("annotations",) if labels(house.objects) else ())}),
            T_world_pano=viewpoint.T_world_pano,
            places={PlaceSource.REGION: f"region-{region}"},
            sources=sources,
        )


def _stitch(viewpoint: Viewpoint, house: HouseFile, height: int, color: Color) -> Panorama:
    """Stitch the panorama of a viewpoint and label its pixels. Raises DataError if an image is missing or damaged."""
    panorama = viewpoint.stitch(height, color)
    range_m = cast(np.ndarray, panorama.range_m)  # a stitched panorama always has a range image
    annotations = Annotations(label_pixels(range_m, viewpoint.T_world_pano, house.objects), labels(house.objects))
    return Panorama(panorama.id, panorama.rgb, range_m, panorama.valid, annotations)
