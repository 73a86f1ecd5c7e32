"""The task `latency`: the latency and memory of a saved map."""
