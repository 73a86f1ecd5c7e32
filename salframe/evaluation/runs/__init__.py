"""Run folders: requests, their execution by workers, and what they keep on disk."""
