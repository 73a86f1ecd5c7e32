"""Selection of the scenes of a map to match with a query (docs/explanation/method.md#candidates)."""
