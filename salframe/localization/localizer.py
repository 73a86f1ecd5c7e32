"""The role `Localizer`: a method that localizes panoramas in a map."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator

from salframe.framework.component import ComponentConfig, Role, added, match_only
from salframe.framework.components.identity import identity
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.errors import ConfigError
from salframe.framework.files.columns import Columns
from salframe.localization.answers import Localization, NodeMatches, PointMatches
from salframe.localization.evidence import Evidence
from salframe.localization.posterior import Posterior, read_fitted
from salframe.localization.saved_frames import SavedFrames
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_model import RangeModel
from salframe.panoramas.view import OdometryNoise

Description = Mapping[str, np.ndarray]
"""The description (features) of one panorama by a localizer: named arrays (no object dtype), which can be cached and
saved."""


def range_slot() -> Any:
    """Return the type of the setting `range` of a localizer: the range model for panoramas without range."""
    return slot(
        RangeModel.role,
        optional=True,
        description="range model, which estimates the range of a panorama without a range image; null: the range of "
        "such a panorama remains unknown",
    )


def posterior_slot() -> Any:
    """Return the type of the setting `posterior` of a localizer: the parameters that convert scores to
    probabilities."""
    help = (
        "mapping of parameters that convert scores to probabilities, or the path of a file written by `salframe fit`; "
        "null: answers have no probabilities"
    )
    return Annotated[
        Posterior | None, BeforeValidator(partial(read_fitted, "posterior")), match_only(None, description=help)
    ]


class LevelledConfig(ComponentConfig):
    """Base of the Config of localizers that have the setting `level`."""

    level: Literal["auto", "off"] = added(
        "auto",
        description="correction of camera tilt. auto: tilted panoramas are rotated upright before they are processed. "
        "The tilt of a reference frame is read from its pose. If roll and pitch of the pose are exactly 0, the tilt is "
        "estimated from the images. The tilt of a query is measured by an IMU, or estimated from its images if there "
        "is no IMU; off: panoramas are not rotated",
    )


class Localizer(Role):
    """Finds the place and the pose of a query in a map of panoramas with known places and poses.

    A localizer implements `needs` and three methods. `describe` returns the description of a panorama, `index` receives
    the descriptions of the reference frames, and `match` localizes a query from its description. All other methods have
    a default. `LocalizationMap` does the rest for all localizers: it caches and times descriptions, and saves and opens
    maps.

    If the Config has the field `range: range_slot()`, the range of panoramas without range is estimated. If it has
    `posterior: posterior_slot()`, the answers get probabilities. A localizer holds the index of one map at a time.
    """

    role = "localizer"
    presets = "methods"
    word = "method"
    column_step: ClassVar[int | None] = 1
    """If the panorama is rotated by a multiple of this number of pixel columns, the pose rotates by the same angle and
    the answer does not change otherwise. None: any rotation may change the answer, for example because views are cut
    from the panorama at fixed azimuths."""
    turn_tolerance_m: ClassVar[float] = 1e-4
    """Maximum change of the pose, apart from the rotation itself, if the panorama is rotated by a multiple of
    `column_step`: of the position in metres, and of the heading in radians."""
    range_model: RangeModel | None = None
    """The range model that the setting `range` selects; None: range is not estimated."""
    posterior: Posterior | None = None
    """The value of the setting `posterior`: the parameters that convert scores to probabilities; None: no
    probabilities."""
    level: str = "auto"
    """The value of the setting `level`, if the Config has it: whether tilted panoramas are levelled."""
    odometry: OdometryNoise = OdometryNoise()
    """The value of the setting `odometry`, if the Config has it: the errors of the motion between views."""
    uses_floors: ClassVar[bool] = False
    """Whether `index` reads `floors`; they are then saved with the map."""
    uses: ClassVar[frozenset[str]] = frozenset()
    """Parts of a panorama that `describe` reads if they are present, in addition to `needs`."""
    floors: tuple[FloorMasks, ...] = ()
    """Floors of the map, set before `index` and `open_index`; empty if they are unknown or not used."""

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self.posterior = getattr(self.config, "posterior", None)
        self.level = getattr(self.config, "level", self.level)
        self.odometry = getattr(self.config, "odometry", self.odometry)
        range_config = getattr(self.config, "range", None)
        if range_config is not None:
            self.range_model = registry().build(RangeModel.role, range_config)

    @property
    @abstractmethod
    def needs(self) -> frozenset[str]:
        """Parts of a panorama that `describe` requires, of "rgb", "range" and "annotations"."""

    @abstractmethod
    def describe(self, panorama: Panorama) -> Description:
        """Return the description of a panorama. Must not change its input."""

    @abstractmethod
    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        """Prepare matching with the reference frames of a map.

        Args:
            descriptions: One description for each frame.
            frames: The frames: id, place and pose.
        """

    @abstractmethod
    def match(self, description: Description) -> Localization:
        """Localize a query from its description. If no place is found, return an answer whose status states the reason;
        do not raise an exception."""

    def join(
        self, descriptions: Sequence[Description], T_last_view: np.ndarray, odometry: OdometryNoise
    ) -> Description | None:
        """Join the descriptions of several views of a query to one description in the frame of the last view.

        Return None (the default) if the localizer cannot join these views. Each view is then localized alone, and the
        probabilities are multiplied.

        Args:
            descriptions: The descriptions of V views, in the order in which they were taken.
            T_last_view: (V, 4, 4) poses of the views in the frame of the last view.
            odometry: The errors of these poses.
        """
        return None

    def pack(self, description: Description) -> Description:
        """Return the arrays of a description that a map stores. By default, these are all arrays."""
        return description

    def unpack(self, packed: Description) -> Description:
        """Return the description from packed arrays, up to the rounding of `pack`."""
        return packed

    def write_index(self, folder: Path) -> None:
        """Write the result of `index` to a new folder, so that the map opens faster.

        Optional; override it together with `open_index`. The default writes nothing.
        """

    def open_index(self, folder: Path, packed: Columns, frames: SavedFrames) -> None:
        """Restore the result of `index` from the files of `write_index`.

        Another process may remove the files while the index is in use. The index must then still work.

        Args:
            folder: The folder that `write_index` wrote.
            packed: Packed descriptions, mapped into memory.
            frames: Reference frames, mapped into memory.

        Raises:
            ConfigError: The class overrides `write_index` and not `open_index`.
        """
        raise ConfigError(
            f"the localizer {self.name!r} overrides `write_index` and not `open_index`, expected both or neither"
        )

    def describe_identity(self) -> dict[str, Any]:
        """Return everything except the panorama that descriptions (features) depend on: weights, and settings that
        affect more than matching (not declared `match_only`)."""
        return identity(self.config, describing=True)

    def note(self, description: Description) -> str | None:
        """Return a remark for the user on a description, such as objects that were left out; None: no remark."""
        return None

    def unknown_labels(self, description: Description) -> tuple[str, ...]:
        """Return the labels of a described query that are missing in the map; () for methods without labels."""
        return ()

    def complete(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> Sequence[Description]:
        """Complete the descriptions of the reference frames of a map with information from the other frames, and return
        them.

        A localizer that triangulates objects from their bearings in several frames does so here. The default returns
        `descriptions` unchanged.

        Args:
            descriptions: One description for each frame.
            frames: The frames: id, place and pose.
        """
        return descriptions

    def unfit_for_map(self, description: Description) -> str | None:
        """Return the reason why a frame with this description cannot be a reference frame, and what to do; None if the
        frame can be used."""
        return None

    def count_objects(self, description: Description) -> int:
        """Return the number of objects in a description, used by the posterior; 0 for methods without objects."""
        return 0

    def correspond(self, query: Description, reference: Description) -> PointMatches | NodeMatches | None:
        """Return the matched points or objects of two descriptions; None for methods that match neither."""
        return None

    def evidence(self, description: Description) -> Evidence | None:
        """Return the evidence for the places of the map: for each hypothesis, the values whose weighted sum is its
        score.

        The columns are in the order of the setting `weights`. Return None for methods without weights, and for queries
        without these values.
        """
        return None

    def shown_directions(self, description: Description) -> np.ndarray | None:
        """Return the directions that each view of a query shows, (V, B) bool, for `Localization.next_view`.

        The last row is the latest view. The B azimuth bins have equal widths and start at the x axis of the levelled
        query, counter-clockwise. None (the default): unknown.
        """
        return None
