"""Run folders: requests, their execution by workers, and the files that they write."""
