"""Which scenes of a map are worth matching to a query (docs/explanation/method.md#candidates)."""
