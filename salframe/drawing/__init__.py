"""Pictures: panoramas with their objects, plans of saliency graphs, floors of topological maps."""
