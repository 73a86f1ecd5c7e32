"""The task `scale`: the cost and recall of matching in a map of many scenes (graphs of panoramas)."""
