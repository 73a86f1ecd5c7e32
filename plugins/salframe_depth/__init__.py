"""Range from colour: monocular depth networks on panoramas."""

import salframe


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """Return the range models `onnx-depth` and `transformers-depth`."""
    from salframe_depth.range_model import OnnxDepth
    from salframe_depth.transformers_depth import TransformersDepth

    return [OnnxDepth, TransformersDepth]
