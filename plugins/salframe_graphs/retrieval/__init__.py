"""Selection of the scenes of a map that are matched with a query. A scene is the graph of one reference frame
(docs/explanation/single-panoramas.md#candidates)."""
