"""The task `matching`: the accuracy of the points or objects that a method matches."""
