"""Panoramas on disk in the open folder format, ours and everybody's."""

import salframe


@salframe.hookimpl
def salframe_components():
    from salframe_folder.dataset import FolderDataset

    return [FolderDataset]
