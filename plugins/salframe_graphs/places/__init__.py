"""Places as merged graphs in the world, matched by a likelihood ratio under one pose (method.md 3b)."""
