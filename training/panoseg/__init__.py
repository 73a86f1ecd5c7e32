"""Training of `panoseg`: render panoramas, train, export to ONNX. Run `python -m training.panoseg.train OUTPUT`."""
