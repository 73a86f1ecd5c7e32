"""The row of the task `sensor`: annotated and detected objects of one panorama."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from salframe.evaluation.runs.rows import Line, PieceRow, PieceStatus

Vector = tuple[float | None, float | None, float | None]


class ObjectsLine(Line):
    """Objects of a panorama. Each list has a value for each object; None is an unknown value."""

    labels: tuple[str, ...]
    scores: tuple[Annotated[float, Field(ge=0, le=1)], ...]
    centroid_m: tuple[Vector, ...]
    size_m: tuple[Vector, ...]
    yaw_rad: tuple[float | None, ...]
    bearing: tuple[Vector, ...]
    solid_angle_sr: tuple[float | None, ...]

    @model_validator(mode="after")
    def _complete(self) -> ObjectsLine:
        parts = (self.scores, self.centroid_m, self.size_m, self.yaw_rad, self.bearing, self.solid_angle_sr)
        if any(len(part) != len(self.labels) for part in parts):
            raise ValueError(
                f"a result row has lists of different lengths, expected one value for each of its {len(self.labels)} "
                "labels in every list"
            )
        return self


class LookRow(PieceRow):
    """The annotated objects of a panorama, the visibility of each, and the detections.

    Attributes:
        frame: Id of the panorama.
        truth: The annotated objects.
        detections: The detections.
        range_m: Range of each annotated object in metres; None if it is unknown.
        hidden_share: Share of the outline of each annotated object that borders something nearer; None if it is
            unknown.
    """

    frame: str
    truth: ObjectsLine | None = None
    detections: ObjectsLine | None = None
    range_m: tuple[float | None, ...] | None = None
    hidden_share: tuple[float | None, ...] | None = None

    @model_validator(mode="after")
    def _complete(self) -> LookRow:
        if self.status != PieceStatus.OK:
            return self
        if self.truth is None or self.detections is None or self.range_m is None or self.hidden_share is None:
            raise ValueError(
                "a result row with the status ok lacks a field, expected `truth`, `detections`, `range_m` and "
                "`hidden_share`"
            )
        if not len(self.truth.labels) == len(self.range_m) == len(self.hidden_share):
            raise ValueError(
                f"`range_m` has {len(self.range_m)} values and `hidden_share` has "
                f"{len(self.hidden_share)}, expected {len(self.truth.labels)}, one for each object of "
                "`truth`"
            )
        return self
