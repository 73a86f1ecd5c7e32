"""From a panorama to its 360-degree saliency graph (docs/explanation/method.md#from-panorama-to-graph): detections,
boxes, saliency, graphs, and their packing."""
