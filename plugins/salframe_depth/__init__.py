"""Range from colour: monocular depth networks on panoramas."""

import salframe


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """Return the range model `onnx-depth`."""
    from salframe_depth.range_model import OnnxDepth

    return [OnnxDepth]
