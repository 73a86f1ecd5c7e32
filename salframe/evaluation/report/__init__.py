"""Reports of runs: one HTML file each that needs nothing else."""
