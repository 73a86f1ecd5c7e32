"""Real buildings from public annotations of Matterport3D, and the REVERIE task."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_matterport.dataset import MatterportAnnotations
    from salframe_matterport.habitat_maps import HabitatMaps
    from salframe_matterport.importer import Matterport3DImporter
    from salframe_matterport.matterport3d import Matterport3D
    from salframe_matterport.reverie import Reverie

    return [MatterportAnnotations, HabitatMaps, Matterport3D, Matterport3DImporter, Reverie]
