"""Baselines that compare objects without a graph."""

import salframe
from salframe_objects.localizer import ObjectSetLocalizer, SalientObjectsLocalizer
from salframe_objects.sovs import SalientVolumesLocalizer


@salframe.hookimpl
def salframe_provides():
    return [ObjectSetLocalizer, SalientObjectsLocalizer, SalientVolumesLocalizer]
