"""Training of `loftr-compact`: render panoramas, cut pairs of views with their exact correspondences, train, export to
ONNX.

`python -m training.loftr_compact FOLDER` does all of it.
"""
