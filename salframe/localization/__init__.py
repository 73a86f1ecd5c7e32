"""Where was a panorama taken? Localizers, their answers, positioning (method.md 3 and 4), and the map on disk."""
