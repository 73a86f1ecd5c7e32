"""The base of salframe: components, their settings, identity and discovery, files, and network weights.

This package does not depend on any role except `engine`.
"""
