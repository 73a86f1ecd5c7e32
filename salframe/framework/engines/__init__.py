"""Engines: how independent pieces of work are run, and the processes that run them."""
