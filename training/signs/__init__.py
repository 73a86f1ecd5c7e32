"""Measurements of signs as evidence for the place of a query."""
