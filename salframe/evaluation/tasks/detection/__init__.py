"""The task `detection`: precision and recall of detectors against annotations."""
