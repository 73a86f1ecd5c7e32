"""Draw pictures: panoramas with their objects, plans of saliency graphs, and floors of topological maps."""
