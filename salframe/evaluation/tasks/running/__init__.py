"""The task `running`: the latency and memory of a saved map."""
