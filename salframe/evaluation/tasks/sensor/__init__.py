"""The task `sensor`: calibration of a sensor model of detectors against annotations."""
