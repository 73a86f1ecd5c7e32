"""The mark of a plugin's hooks."""

from pluggy import HookimplMarker

hookimpl = HookimplMarker("salframe")
"""Marks a plugin's `salframe_provides` and `salframe_commands` functions."""
