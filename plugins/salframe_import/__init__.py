"""Importers of recordings: pictures with a table of poses, posed images, cubemaps, TUM RGB-D, COLMAP and ROS bags."""

from __future__ import annotations

import salframe


@salframe.hookimpl
def salframe_provides() -> list[type[salframe.Component]]:
    """Return the importers."""
    from salframe_import.colmap import ColmapImporter
    from salframe_import.cubemap import CubemapImporter
    from salframe_import.perspective import PerspectiveImporter
    from salframe_import.pictures import PictureImporter
    from salframe_import.rosbag import RosBagImporter
    from salframe_import.tum import TumImporter

    return [PictureImporter, PerspectiveImporter, CubemapImporter, TumImporter, ColmapImporter, RosBagImporter]
