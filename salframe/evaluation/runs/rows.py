"""What the lines of a run's .jsonl files must hold, task by task, to be read again. Further keys are left alone."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from salframe.evaluation.statistics import PLACED
from salframe.evaluation.runs.run_folder import PieceStatus

Count = Annotated[int, Field(ge=0, strict=True)]
Amount = Annotated[float, Field(ge=0)]
Pose = Annotated[tuple[float, ...], Field(min_length=16, max_length=16)]
Position = Annotated[tuple[float, ...], Field(min_length=4, max_length=4)]


class Line(BaseModel):
    """Base of what stands in a line."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)


class PieceRow(Line):
    """What a method made of a piece of any task."""

    status: str
    error: str | None


class AnswerRow(PieceRow):
    """An answer to a query."""

    fold: str
    query: str
    places: tuple[tuple[str, str, float], ...]
    pose: Pose | None
    heading: float | None = None
    probabilities: tuple[float, ...] | None = None
    not_here: float | None = None
    covariance: tuple[tuple[float, ...], ...] | None = None
    query_ms: Amount | None
    describe_ms: Amount | None
    peak_memory_mb: Amount | None

    @model_validator(mode="after")
    def _complete(self) -> AnswerRow:
        if self.status in PLACED and not self.places:
            raise ValueError(f"an answer of status {self.status} has no place, expected one")
        if self.covariance is not None:
            sides = {len(self.covariance), *map(len, self.covariance)}
            if sides not in ({3}, {6}):
                raise ValueError("a covariance is neither (3, 3) nor (6, 6)")
        if len(self.probabilities or ()) != (0 if self.not_here is None else len(self.places)):
            raise ValueError("an answer has not_here or probabilities, expected both, one for each place, or none")
        return self


class PairRow(PieceRow):
    """What a method matched of a pair of frames."""

    fold: str
    query: str
    kind: Literal["points", "nodes"] | None = None
    matches: Count | None = None
    judged: Count | None = None
    within_px: tuple[Count, ...] | None = None
    correct: Count | None = None
    true: Count | None = None

    @model_validator(mode="after")
    def _complete(self) -> PairRow:
        counted = (self.judged, self.within_px) if self.kind == "points" else (self.correct, self.true)
        if self.status == PieceStatus.OK and None in (self.kind, self.matches, *counted):
            raise ValueError("a pair that was matched has no count of matches, expected all of its kind")
        return self


class PanoramaRow(PieceRow):
    """What a detector found in a panorama."""

    query: str
    annotated: dict[str, Count] | None = None
    found: dict[str, Count] | None = None
    right: dict[str, Count] | None = None
    joined: dict[str, str] | None = None
    ms: Amount | None = None

    @model_validator(mode="after")
    def _complete(self) -> PanoramaRow:
        counted = (self.annotated, self.found, self.right, self.joined)
        if None in counted and (self.status == PieceStatus.OK or any(part is not None for part in counted)):
            raise ValueError("a panorama has some of annotated, found, right and joined, expected all of them")
        return self


Vector = tuple[float | None, float | None, float | None]


class ObjectsLine(Line):
    """Objects of a panorama, a value of each list an object; None is what is not known."""

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
            raise ValueError(f"expected a value for each of {len(self.labels)} labels in every list")
        return self


class LookRow(PieceRow):
    """The annotated objects of a panorama, how each shows, and what a detector found there."""

    frame: str
    truth: ObjectsLine | None = None
    found: ObjectsLine | None = None
    range_m: tuple[float | None, ...] | None = None
    hidden_share: tuple[float | None, ...] | None = None

    @model_validator(mode="after")
    def _complete(self) -> LookRow:
        if self.status != PieceStatus.OK:
            return self
        if self.truth is None or self.found is None or self.range_m is None or self.hidden_share is None:
            raise ValueError("a panorama was looked at, expected truth, found, range_m and hidden_share")
        if not len(self.truth.labels) == len(self.range_m) == len(self.hidden_share):
            raise ValueError("expected range_m and hidden_share of each annotated object")
        return self


class EpisodeRow(PieceRow):
    """What an agent did in an episode."""

    episode: Count
    world: str
    goal: str
    success: bool
    oracle: bool
    spl: float = Field(ge=0, le=1)
    success_1m: bool
    success_3m: bool
    shortest_m: Amount
    path: tuple[Position, ...] | None = None
    travelled_m: Amount | None = None
    panoramas: Count | None = None
    collisions: Count | None = None

    @model_validator(mode="after")
    def _complete(self) -> EpisodeRow:
        if self.path is not None and None in (self.travelled_m, self.panoramas, self.collisions):
            raise ValueError("an episode has a path, but not travelled_m, panoramas and collisions")
        return self


class ScaleLine(PieceRow):
    """Whether a scene was found again, and what its map cost."""

    query: Count
    right: bool | None = None
    right_exhaustive: bool | None = None
    query_ms: float | None = None
    build_s: float | None = None
    build_memory_mb: float | None = None
    bytes: Count | None = None
    open_s: float | None = None


class RunningLine(PieceRow):
    """What asking a saved map cost, and the map itself."""

    query: str
    first: bool | None = None
    describe_ms: Amount | None = None
    query_ms: Amount | None = None
    scenes: Annotated[int, Field(gt=0)] | None = None
    bytes: Count | None = None
    open_s: Amount | None = None
    opened_mb: Amount | None = None
    asked_mb: Amount | None = None

    @model_validator(mode="after")
    def _complete(self) -> RunningLine:
        needed = (self.first, self.describe_ms, self.query_ms, self.scenes, self.bytes, self.open_s)
        if self.status == PieceStatus.OK and None in needed:
            raise ValueError("a query was answered, expected its times and what its map cost")
        return self


class DescriptionLine(Line):
    """What describing a frame cost."""

    frame: str
    ms: Amount


class MapLine(Line):
    """What the map of a fold takes."""

    fold: str
    frames: Annotated[int, Field(gt=0)]
    bytes: Count
