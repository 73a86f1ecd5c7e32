"""Example plugin for a robot with a range finder: a component for each role, and presets that use them."""

from pathlib import Path

import salframe
from salframe_rangefinder.detector import HeightBands
from salframe_rangefinder.evidence import RangeSpectrum
from salframe_rangefinder.localizer import RangeProfile
from salframe_rangefinder.planner import NetworkxPlanner
from salframe_rangefinder.rooms import BoxRooms
from salframe_rangefinder.stages import ApparentSize, BoxSizes, PlanarFit
from salframe_rangefinder.tracker import ConfirmedAnswers


@salframe.hookimpl
def salframe_provides():
    presets = salframe.Presets(Path(__file__).parent / "presets")
    stages = [ApparentSize, BoxSizes, PlanarFit, RangeSpectrum]
    return [BoxRooms, HeightBands, *stages, NetworkxPlanner, RangeProfile, ConfirmedAnswers, presets]
