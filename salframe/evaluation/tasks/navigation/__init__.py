"""The task `navigation`: methods in closed-loop navigation, in the buildings of a dataset."""
