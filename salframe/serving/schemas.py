"""Models of the bodies of requests and answers. The OpenAPI description contains them."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

MAX_NAME = 200
"""Maximum number of characters of a name or label."""
MAX_COORDINATE_M = 1e6
"""Maximum magnitude of a coordinate in a request, in metres."""
_Metres = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
_Size = Annotated[float, Field(ge=0, le=MAX_COORDINATE_M)]
_Vector = Annotated[list[_Metres], Field(min_length=3, max_length=3)]
_Seconds = Annotated[float, Field(ge=-1e12, le=1e12)]
_Angle = Annotated[float, Field(ge=-360, le=360)]


class RequestBody(BaseModel):
    """Base of the bodies of requests. Unknown keys, infinity and NaN are not allowed.

    All limits are constraints of pydantic fields, because pydantic checks such constraints in fast compiled code.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class DetectedObject(RequestBody):
    """An object in the panorama frame (x ahead, y left, z up). It has either a position and a size, or a direction."""

    label: str = Field(min_length=1, max_length=MAX_NAME)
    score: float = Field(1.0, ge=0, le=1)
    centroid_m: _Vector | None = Field(None, description="centre of the box in metres")
    size_m: Annotated[list[_Size], Field(min_length=3, max_length=3)] | None = Field(
        None, description="length, width and height of the upright box in metres"
    )
    yaw_deg: _Angle = Field(0.0, description="azimuth of the length of the box (degrees)")
    azimuth_deg: _Angle | None = Field(None, description="azimuth (degrees) of an object without position")
    elevation_deg: float | None = Field(
        None, ge=-90, le=90, description="elevation (degrees) of an object without position"
    )
    solid_angle_sr: float | None = Field(
        None, ge=0, le=12.6, description="solid angle (steradians) that the object covers"
    )

    @model_validator(mode="after")
    def _check_position(self) -> Self:
        has_position = self.centroid_m is not None and self.size_m is not None
        has_direction = self.azimuth_deg is not None and self.elevation_deg is not None
        if has_position == has_direction:
            received = "both" if has_position else "neither"
            raise ValueError(
                f"received an object with {received} a position {'and' if has_position else 'nor'} a direction, "
                "expected either `centroid_m` and `size_m`, or `azimuth_deg` and `elevation_deg`"
            )
        return self


class Motion(RequestBody):
    """The motion of the robot since the previous observation, in the frame of its base before the motion."""

    x_m: float = Field(ge=-1000, le=1000, description="motion forward in metres")
    y_m: float = Field(0.0, ge=-1000, le=1000, description="motion to the left in metres")
    z_m: float = Field(0.0, ge=-1000, le=1000, description="motion upward in metres")
    yaw_deg: float = Field(0.0, ge=-3600, le=3600, description="rotation in degrees, counter-clockwise from above")


class DetectionsQuery(RequestBody):
    """The JSON body of a query: detections of one panorama."""

    detections: list[DetectedObject]


class DetectionsObservation(DetectionsQuery):
    """The JSON body of an observation: detections of one panorama, with time and odometry."""

    t_s: _Seconds = Field(description="time of the view in seconds, later than that of the previous observation")
    odometry: Motion | None = Field(None, description="motion since the previous observation; null: unknown")


class PoseBody(BaseModel):
    """A pose in the world frame of the map: metres and degrees."""

    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float


class CovarianceBody(BaseModel):
    """The covariance of a pose. Rows and columns of axes that are not in `estimated` are 0."""

    frame: Literal["world"]
    axes: list[str] = Field(description="axes of rows and columns: metres, and radians about the axes of the world")
    estimated: list[str]
    matrix: list[list[float]] = Field(description="6 x 6 covariance matrix")


class RankedPlaceBody(BaseModel):
    """A candidate place."""

    place: str
    frame: str = Field(description="id of the best reference frame of the place")
    score: float
    probability: float | None


class MatchedObject(BaseModel):
    """An object of the best reference frame that was matched with an object of the query."""

    label: str
    xyz_m: list[float] = Field(description="centre in the world frame")


class QueryObject(BaseModel):
    """An object of the query."""

    label: str
    score: float
    saliency: float
    azimuth_deg: float
    elevation_deg: float
    centroid_m: list[float] | None = Field(description="centre in the frame of the panorama; null: unknown")
    size_m: list[float] | None
    yaw_deg: float | None
    outline: list[list[list[float]]] = Field(
        description="closed lines around the object in the picture, x and y from 0 to 1; empty for JSON queries"
    )
    matched: MatchedObject | None


class AnswerBody(BaseModel):
    """The answer to a query."""

    status: str = Field(description="ok, no-pose, or why the query was not localized")
    accepted: bool | None = Field(
        description="whether a program should use the answer; null: the answer has no probabilities"
    )
    places: list[RankedPlaceBody] = Field(description="candidate places, best first")
    out_of_map_probability: float | None
    pose: PoseBody | None
    T_world_query: list[list[float]] | None = Field(
        description="pose as a 4 x 4 matrix, translation in metres; null: unknown"
    )
    covariance: CovarianceBody | None
    heading_deg: float | None
    notes: list[str]
    map_version: str
    seconds: float = Field(description="computation time in seconds")
    objects: list[QueryObject] | None = Field(
        None, description="detected objects of the query; only with ?objects=true"
    )
    edges: list[list[int]] | None = Field(
        None, description="pairs of indices of objects that an edge connects; only with ?objects=true"
    )
    picture: str | None = Field(
        None, description="data URL of the image, placed on the sphere as a panorama; only with ?picture=true"
    )


class StartPose(RequestBody):
    """A pose on a floor of the map."""

    x_m: _Metres
    y_m: _Metres
    z_m: _Metres = Field(0.0, description="height (m) of the camera or of the floor")
    yaw_deg: _Angle | None = Field(None, description="heading in degrees; null: unknown")


class RouteStart(RequestBody):
    """Start of a route: exactly one of these fields. If an answer has no pose, use its best reference frame."""

    pose: StartPose | None = None
    place: str | None = Field(None, max_length=MAX_NAME, description="name of a place or node")
    frame: str | None = Field(
        None, max_length=MAX_NAME, description="id of the reference frame of an answer without pose"
    )

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        count = sum(value is not None for value in (self.pose, self.place, self.frame))
        if count != 1:
            raise ValueError(f"received {count} of the keys `pose`, `place` and `frame`, expected exactly one")
        return self


class RouteGoal(RequestBody):
    """Goal of a route: exactly one of these fields."""

    place: str | None = Field(None, max_length=MAX_NAME, description="name of a place or node")
    point: StartPose | None = None

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        if (self.place is None) == (self.point is None):
            received = "neither" if self.place is None else "both"
            raise ValueError(f"received {received} of the keys `place` and `point`, expected exactly one")
        return self


class RouteQuery(RequestBody):
    """The JSON body of a route query."""

    start: RouteStart
    goal: RouteGoal


class RouteStepBody(BaseModel):
    """A step of a route: turn, then walk straight ahead."""

    to: str | None
    length_m: float
    azimuth_deg: float
    turn_deg: float | None = Field(description="turn in degrees, positive to the left; null: the heading is unknown")
    say: str = Field(description="instruction for the step in words")


class RouteBody(BaseModel):
    """A route."""

    nodes: list[str]
    length_m: float
    steps: list[RouteStepBody]
    line: list[list[float]] = Field(description="corners (x, y, z) of the route in metres in the world frame")


class SessionBody(BaseModel):
    """The response that describes a new session."""

    id: str
    idle_s: float = Field(description="time in seconds without observations after which the session ends")


class BeliefBody(BaseModel):
    """Belief of a session on the pose of the robot."""

    status: str = Field(description="tracking, lost, or out-of-map")
    place: str | None
    pose: PoseBody | None
    T_world_base: list[list[float]] | None = Field(
        description="pose as a 4 x 4 matrix, translation in metres; null: unknown"
    )
    covariance: CovarianceBody | None
    t_s: float | None = Field(description="time of the last observation in seconds; null: no observation")
    observations: int
    places: list[RankedPlaceBody] = Field(description="candidate places of the last answer")


class ObservationBody(BaseModel):
    """The answer to an observation, and the belief of the session after it."""

    answer: AnswerBody
    belief: BeliefBody


class HealthBody(BaseModel):
    """Whether the service runs."""

    status: Literal["ok", "stale"] = Field(
        description="ok: the map is up to date; stale: the map file has changed and could not be opened"
    )
    version: str = Field(description="version of salframe")


class ProblemBody(BaseModel):
    """An error as in RFC 9457."""

    type: str
    title: str
    status: int
    detail: str
