"""Measures of derived floors against given floor masks."""
