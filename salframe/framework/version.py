"""The version of salframe that is installed."""

from importlib.metadata import version

__version__ = version("salframe")
