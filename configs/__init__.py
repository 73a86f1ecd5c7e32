"""salframe's own presets: methods, data sets, ablations, and what papers report; and the names that stand where none is
given."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import salframe

if TYPE_CHECKING:
    from salframe.framework.hookspecs import Presets


@salframe.hookimpl
def salframe_provides() -> list[Presets]:
    from salframe.framework.hookspecs import Presets  # the command line reads the defaults before it needs a registry

    return [Presets(Path(__file__).parent)]
