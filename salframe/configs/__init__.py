"""salframe's own presets: methods, data sets, ablations, published results, and the default names.

The files lie in configs/ of the repository; a wheel carries them here.
"""

from __future__ import annotations

import salframe
from salframe.framework.components.defaults import preset_folder
from salframe.framework.hookspecs import Presets


@salframe.hookimpl
def salframe_provides() -> list[Presets]:
    return [Presets(preset_folder())]
