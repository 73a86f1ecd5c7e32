"""The version of the installed salframe."""

from importlib.metadata import version

__version__ = version("salframe")
