"""salframe's own presets: methods, data sets, ablations, and what papers report; and the names that stand where none is
given."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import salframe


@salframe.hookimpl
def salframe_provides() -> list[Any]:
    from salframe.framework.registry import Presets

    return [Presets(Path(__file__).parent)]
