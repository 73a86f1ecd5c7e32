"""Image baselines: features of perspective views by a network in ONNX, compared as they are."""

import salframe


@salframe.hookimpl
def salframe_components() -> list[type]:
    """None yet."""
    return []
