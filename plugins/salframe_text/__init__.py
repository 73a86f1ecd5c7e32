"""Text on the walls: the detector `text` reads signs, the evidence `text` compares their strings."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_text.detector import TextDetector
    from salframe_text.evidence import TextEvidence

    return [TextDetector, TextEvidence]
