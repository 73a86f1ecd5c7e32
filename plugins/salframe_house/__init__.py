"""Dataset `house`: rendered, furnished buildings."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_house.dataset import House

    return [House]
