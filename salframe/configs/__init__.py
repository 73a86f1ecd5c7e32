"""Presets of salframe: methods, data sets, ablations, published results, and default names.

The files are in configs/ of the repository, and in this folder of a wheel.
"""

from __future__ import annotations

import salframe
from salframe.framework.components.defaults import preset_folder
from salframe.framework.hookspecs import Presets


@salframe.hookimpl
def salframe_provides() -> list[Presets]:
    return [Presets(preset_folder())]
