"""Training of `panoseg`: render panoramas, train, export to ONNX: `python -m training.panoseg.train OUTPUT`."""
