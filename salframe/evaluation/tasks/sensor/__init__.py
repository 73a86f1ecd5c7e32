"""The task `sensor`: a detector measured against annotations, as a sensor model."""
