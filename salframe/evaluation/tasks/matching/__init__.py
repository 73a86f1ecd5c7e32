"""The task `matching`: whether the points or objects that a method matches are the same ones."""
