"""Reports of runs: one HTML file that needs no other files."""
