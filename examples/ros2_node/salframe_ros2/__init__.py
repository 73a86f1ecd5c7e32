"""Localize a robot in a map of salframe, with ROS 2."""
