"""Closed-loop navigation (docs/how-to/navigate.md#what-the-agent-knows-and-does): an agent takes a panorama, localizes,
turns towards the next node and walks. It is stopped by walls and misled by wrong answers of the localizer."""
