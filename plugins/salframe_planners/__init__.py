"""Planners: shortest routes on the topological map."""

import salframe


@salframe.hookimpl
def salframe_components() -> list[type]:
    """None yet."""
    return []
