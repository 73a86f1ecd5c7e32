"""The log messages that a command has printed."""

from __future__ import annotations

logged: set[str] = set()
"""Log messages that this command has printed. They are not repeated below the result."""
