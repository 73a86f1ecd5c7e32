"""The topological map of a building (docs/how-to/maps.md#what-the-map-is-made-of): built from floor masks or
range images, stored, exported, and used to plan routes."""
