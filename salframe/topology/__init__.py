"""The topological map of a building (docs/how-to/maps.md#what-the-map-is-made-of): made from floor masks, stored,
drawn, exported, walked."""
