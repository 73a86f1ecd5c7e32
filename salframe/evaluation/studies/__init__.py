"""Several runs together: ablations, experiments and the fitting of parameters to tuning data."""
