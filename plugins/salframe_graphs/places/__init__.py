"""Places as merged graphs in the world, matched by a likelihood ratio that includes the pose
(docs/explanation/places.md#from-panoramas-to-places)."""
