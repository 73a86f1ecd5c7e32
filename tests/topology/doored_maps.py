"""Build maps of the rooms of `doored_plugin`."""

from __future__ import annotations

from pathlib import Path

from salframe.topology.building_map import build_map


def build(directory: str, data: str = "doored", *overrides: str) -> Path:
    build_map(data, directory, "reader", overrides=overrides)
    return Path(directory)
