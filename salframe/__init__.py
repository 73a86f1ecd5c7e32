"""salframe: where am I, and which way do I turn? Localization from one RGB-D panorama by 360-degree saliency graphs."""

from salframe.registry import hookimpl

__all__ = ["hookimpl"]
