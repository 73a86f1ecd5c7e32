"""The base of salframe: plugin components with their settings and cache keys, plugin discovery, files, network weights.

A role is an interface that components implement. Of all roles, this package knows only `engine`.
"""
