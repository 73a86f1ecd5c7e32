"""Importers of recordings: pictures with a table of poses."""

from __future__ import annotations

import salframe


@salframe.hookimpl
def salframe_provides() -> list[type[salframe.Component]]:
    """Return the importers."""
    from salframe_import.pictures import PictureImporter

    from salframe_import.perspective import PerspectiveImporter

    return [PictureImporter, PerspectiveImporter]
