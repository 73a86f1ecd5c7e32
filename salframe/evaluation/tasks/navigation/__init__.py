"""The task `navigation`: methods in closed loop, in the buildings of a dataset."""
