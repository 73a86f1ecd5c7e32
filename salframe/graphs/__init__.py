"""From a panorama to its 360-degree saliency graph (method.md 2): detections, boxes, saliency, graphs, and their
packing."""
