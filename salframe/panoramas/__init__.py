"""Panoramas and datasets: geometry, perspective views, the folder format, annotations."""
