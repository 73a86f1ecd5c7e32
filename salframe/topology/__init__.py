"""The topological map of a building (method.md 1): made from floor masks, stored, drawn, exported, walked."""
