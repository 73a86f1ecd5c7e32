"""The row of the task `detection`: the detections in one panorama."""

from __future__ import annotations

from pydantic import model_validator

from salframe.evaluation.runs.rows import Amount, Count, PieceRow, PieceStatus


class PanoramaRow(PieceRow):
    """Numbers of annotated, detected and correctly detected objects of a panorama, by label."""

    query: str
    annotated: dict[str, Count] | None = None
    detections: dict[str, Count] | None = None
    right: dict[str, Count] | None = None
    joined: dict[str, str] | None = None
    ms: Amount | None = None

    @model_validator(mode="after")
    def _complete(self) -> PanoramaRow:
        counted = (self.annotated, self.detections, self.right, self.joined)
        if None in counted and (self.status == PieceStatus.OK or any(part is not None for part in counted)):
            raise ValueError(
                f"a result row with the status {self.status} lacks a field, expected `annotated`, `detections`, "
                "`right` and `joined`"
            )
        return self
