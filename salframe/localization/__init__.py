"""Localize panoramas in a map: localizers, their answers, positioning
(docs/explanation/single-panoramas.md#matching-with-single-panoramas), and the saved map."""
