"""Places as merged graphs in the world, matched by a likelihood ratio under one pose
(docs/explanation/method.md#from-panoramas-to-places)."""
