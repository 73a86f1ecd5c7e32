"""Panoramas and where they come from: geometry, perspective views, data sets, the folder format, annotations."""
