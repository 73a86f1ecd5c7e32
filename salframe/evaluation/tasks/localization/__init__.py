"""The task `localization`: the place and pose of every query of a dataset."""
