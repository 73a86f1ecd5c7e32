"""Which scenes of a map are worth matching to a query (method.md 3, step 1)."""
