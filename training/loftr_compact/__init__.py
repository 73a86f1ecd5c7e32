"""Training of `loftr-compact`: render panoramas, cut pairs of views with exact correspondences, train, export to ONNX.

`python -m training.loftr_compact FOLDER` runs all steps.
"""
