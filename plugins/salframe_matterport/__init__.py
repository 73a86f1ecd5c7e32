"""Real buildings from public annotations of Matterport3D."""

import salframe


@salframe.hookimpl
def salframe_components():
    from salframe_matterport.dataset import MatterportAnnotations

    return [MatterportAnnotations]
