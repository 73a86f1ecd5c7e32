"""Simulated closed-loop navigation (docs/how-to/navigate.md#what-the-agent-knows-and-does): an agent takes a panorama,
localizes itself, turns towards the next node and walks. Walls stop the agent, and wrong answers of the localizer
mislead it."""
