"""Comparison of floors that are derived from panoramas with the floor masks of generated buildings."""
