"""Rendered, furnished buildings."""

import salframe


@salframe.hookimpl
def salframe_components():
    from salframe_house.dataset import House

    return [House]
