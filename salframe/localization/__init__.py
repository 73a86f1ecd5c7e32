"""Localize panoramas in a map: localizers, their answers, positioning
(docs/explanation/method.md#from-graph-to-panorama), and the saved map."""
