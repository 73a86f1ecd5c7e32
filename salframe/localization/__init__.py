"""Where was a panorama taken? Localizers, their answers, positioning
(docs/explanation/method.md#from-graph-to-panorama), and the map on disk."""
