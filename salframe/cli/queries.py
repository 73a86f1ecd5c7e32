"""The query of the command `localize`: frames of a dataset, panoramas from image files, or photographs of a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from salframe.panoramas.camera import Camera
    from salframe.panoramas.view import View


@dataclass(frozen=True, kw_only=True)
class QueryOptions:
    """Options of the command `localize` that define the query.

    Attributes:
        frames: Paths of images, or ids of frames of the dataset.
        is_sequence: Whether the frames are views of one query.
        motion: CSV file with the motion between the views; None: the motion is unknown.
        data: Dataset that contains the frames; None: the frames are image files.
        data_dir: Folder with the files of the dataset.
        overrides: Settings of the dataset, "key.path=value" each.
        rgb: Colour image in place of `frames`.
        ranges: Range images, one for each view; empty: no range images.
        instances: Images of object ids, one for each view; empty: no annotations.
        labels: JSON file with the labels of the object ids.
        encoding: Options of the range images, as `range_options` returns them.
        camera: Camera file of photographs; None: panoramas, or photographs with `fov_deg`.
        fov_deg: Horizontal field of view of photographs in degrees; None: panoramas, or photographs with `camera`.

    Raises:
        ConfigError: Options contradict each other.
    """

    frames: Sequence[str]
    is_sequence: bool
    motion: Path | None
    data: str | None
    data_dir: Path | None
    overrides: Sequence[str]
    rgb: Path | None
    ranges: Sequence[Path]
    instances: Sequence[Path]
    labels: Path | None
    encoding: dict[str, Any]
    camera: Path | None
    fov_deg: float | None

    def __post_init__(self) -> None:
        from salframe.framework.errors import ConfigError, counted

        has_images = self.rgb is not None or bool(self.ranges or self.instances) or self.labels is not None
        if self.is_sequence and self.rgb is not None:
            raise ConfigError("received --views with --rgb, expected the views as arguments: --views a.jpg b.jpg")
        takes_both = self.rgb is None and (self.is_sequence or self.are_photographs)
        if self.is_sequence and not self.frames:
            raise ConfigError("received --views without a view, expected the views as arguments: --views a.jpg b.jpg")
        if not (self.frames or has_images):
            raise ConfigError(
                "received neither FRAME (a file, or the id of a panorama in --data) nor image files such as --rgb "
                "FILE, expected one of them"
            )
        if self.frames and has_images and not takes_both:
            raise ConfigError(
                "received both FRAME and image files such as --rgb FILE, expected only one of them, or a photograph as "
                "FRAME with --fov or --camera"
            )
        if not self.is_sequence and (len(self.frames) > 1 or self.motion is not None):
            received = f"{len(self.frames)} values for FRAME" if len(self.frames) > 1 else "--motion"
            raise ConfigError(
                f"received {received} without --views: add --views to localize several views as one query"
            )
        if self.camera is not None and self.fov_deg is not None:
            raise ConfigError("received both --camera and --fov, expected only one of them")
        if self.are_photographs and self.data is not None:
            raise ConfigError(
                "received --data with --fov or --camera, which are only for image files: leave out --fov and --camera"
            )
        if self.are_photographs and not (self.frames or self.rgb):
            raise ConfigError("received --fov or --camera without a photograph, expected the photograph as --rgb FILE")
        for option, files in (("--range", self.ranges), ("--instances", self.instances)):
            if files and len(files) != self._num_views:
                raise ConfigError(
                    f"the option {option} was given {counted(len(files), 'time')}, expected {self._num_views}: once "
                    "for each view, in the order of the views"
                )

    @property
    def are_photographs(self) -> bool:
        """Whether the images are photographs of a camera."""
        return self.camera is not None or self.fov_deg is not None

    def read(self) -> list[View]:
        """Read the views of the query, in their order, with the motion between them if it is known.

        Notes on the images and warnings on the camera are printed.

        Raises:
            DataError: A file is missing or malformed.
            UnknownName: There is no such dataset or frame.
        """
        from salframe.cli.output import tell, warn
        from salframe.panoramas.camera_file import read_camera
        from salframe.panoramas.motion_file import read_motion

        motions, up = (None, None) if self.motion is None else read_motion(self.motion, self._num_views)
        camera = None if self.camera is None else read_camera(self.camera)
        for note in () if camera is None else camera.notes:
            warn(f"{self.camera}: {note}")
        views = [
            view
            for number in range(self._num_views)
            for view in self._read_views(number, camera, None if motions is None else motions[number])
        ]
        if up is not None:
            views = [
                replace(view, panorama=replace(view.panorama, up=direction))
                for view, direction in zip(views, up, strict=True)
            ]
        for view in views:
            for note in view.panorama.notes:
                tell(f"{view.panorama.id}: {note}")
        return views

    @property
    def _num_views(self) -> int:
        return max(1, len(self.frames))

    def _read_views(self, number: int, camera: Camera | None, motion: np.ndarray | None) -> list[View]:
        """Return one view; or, if the frame is the last view of a sequence of its dataset, all views of the
        sequence."""
        from salframe.cli.output import Bars, tell
        from salframe.framework.errors import ConfigError
        from salframe.panoramas.frames import QueryFrame
        from salframe.panoramas.image_lookup import find_frame_image
        from salframe.panoramas.opening import open_frame
        from salframe.panoramas.shot import read_panorama
        from salframe.panoramas.view import View

        name = self.frames[number] if self.frames else self.rgb
        range_image = self.ranges[number] if self.ranges else None
        instances = self.instances[number] if self.instances else None
        if self.are_photographs and name is not None:
            return [self._read_photograph(Path(name), range_image, instances, camera, motion)]
        if not self.frames or (self.is_sequence and self.data is None and find_frame_image(Path(str(name))) is None):
            return [View(read_panorama(name, range_image, instances, self.labels, **self.encoding), motion)]
        if range_image or instances or self.labels:
            raise ConfigError(
                f"received image files for the frame {name}, whose images are in its dataset: leave out --range, "
                "--instances and --labels"
            )
        with Bars() as bars:
            frame = open_frame(str(name), self.data, self.data_dir, self.overrides, bars.update)
        if self.is_sequence or not isinstance(frame, QueryFrame) or not frame.earlier:
            return [View(frame.load(), motion)]
        tell(f"{frame.id} is the last of {len(frame.views)} views of a query: all of them are localized together")
        unknown = [None] * len(frame.views)
        between = unknown if frame.T_last_view is None else frame.T_last_view
        return [View(view.load(), T_last_view) for view, T_last_view in zip(frame.views, between, strict=True)]

    def _read_photograph(
        self,
        image: Path,
        depth_image: Path | None,
        instances: Path | None,
        camera: Camera | None,
        motion: np.ndarray | None,
    ) -> View:
        import numpy as np

        from salframe.cli.output import warn
        from salframe.panoramas.range_encoding import MILLIMETRE, RangeEncoding, RangeKind
        from salframe.panoramas.shot import missing_depth_note, open_photograph
        from salframe.panoramas.view import View

        unit_m, missing = self.encoding.get("range_unit_m", MILLIMETRE), self.encoding.get("range_missing", ())
        encoding = RangeEncoding(unit_m, missing, self.encoding.get("range_kind", RangeKind.Z))
        shot = open_photograph(
            image, depth_image, instances, self.labels, camera=camera, fov_deg=self.fov_deg, encoding=encoding
        )
        if note := missing_depth_note(shot, encoding):
            warn(note)
        return View(shot.panorama, motion, np.zeros(3) if camera is None else camera.position_m)
