"""Object sets as a baseline."""

import salframe
from salframe_objects.localizer import ObjectSetLocalizer


@salframe.hookimpl
def salframe_components():
    return [ObjectSetLocalizer]
