"""Engines, which run independent work items, and their worker processes."""
