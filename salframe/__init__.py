"""salframe: where am I, and which way do I turn? Localization from one RGB-D panorama by 360-degree saliency graphs."""

from pluggy import HookimplMarker

__all__ = ["hookimpl"]

hookimpl = HookimplMarker("salframe")
"""Marks a plugin's `salframe_provides` and `salframe_commands` functions."""
