"""Rules of the role `importer`, and of the recordings that an importer reads."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from salframe.framework.errors import DataError, SalframeError
from salframe.panoramas.importer import ImageFiles, Importer, PanoramaRecord, Recording
from salframe.panoramas.panorama import Panorama
from salframe.testing.expectations import attempt, expect, same
from salframe.testing.rules import Conformance, Rules, check_all


class ImporterRules(Rules[Importer]):
    """A source that is not a recording raises a DataError of one line. `check_recording` checks a recording."""

    def a_missing_source_raises_an_error(self) -> None:
        self._check("a missing source", lambda folder: folder / "missing")

    def an_empty_folder_raises_an_error(self) -> None:
        self._check("an empty folder", lambda folder: folder)

    def a_plain_text_file_raises_an_error(self) -> None:
        def write(folder: Path) -> Path:
            (folder / "recording.txt").write_text("no recording\n", encoding="utf-8")
            return folder / "recording.txt"

        self._check("a plain text file", write)

    def _check(self, what: str, prepare: Callable[[Path], Path]) -> None:
        checked, importer = f"read of {what}", self.make()
        with tempfile.TemporaryDirectory() as folder:
            try:
                importer.read(prepare(Path(folder)))
            except SalframeError as error:
                expect(isinstance(error, DataError), checked, type(error).__name__, "DataError")
                expect("\n" not in str(error), checked, "a DataError of several lines", "a DataError of one line")
            except Exception as error:
                expect(False, checked, f"{type(error).__name__}: {error}", "DataError")
            else:
                expect(False, checked, "a recording", "DataError")


class RecordingRules(Rules[Importer]):
    """The panoramas of a recording have the parts that they declare, and do not change when they are read again."""

    def __init__(self, importer: Importer, source: Path) -> None:
        super().__init__(lambda: importer)
        self._source = source

    @cached_property
    def _recording(self) -> Recording:
        return attempt("read", self.make().read, self._source)  # type: ignore[no-any-return]

    def a_recording_is_returned(self) -> None:
        expect(isinstance(self._recording, Recording), "read", type(self._recording).__name__, "Recording")
        num_references = sum(record.is_reference for record in self._recording.records)
        expect(num_references, "read", "no panorama with a pose", "at least one, from which a map can be built")

    def panoramas_have_the_declared_parts(self) -> None:
        for record in self._recording.records:
            panorama = self._load(record)
            parts = panorama.provides | ({"valid"} if panorama.valid is not None else set())
            # The reader of image files also masks crops and black bands, without a file of the mask.
            added = {"valid"} if isinstance(record.images, ImageFiles) else set()
            is_expected = record.parts <= parts <= record.parts | added
            expect(is_expected, f"load of {record.id}", sorted(parts), f"the parts {sorted(record.parts)}")

    def reading_again_gives_the_same(self) -> None:
        again = attempt("second read", self.make().read, self._source)
        poses, poses_again = (
            [(r.id, r.T_world_pano, r.t_s) for r in read.records] for read in (self._recording, again)
        )
        expect(same(poses, poses_again), "second read", "other ids, poses or times", "the same")
        record = self._recording.records[0]
        checked = f"second load of {record.id}"
        expect(same(self._load(record), self._load(record)), checked, "another panorama", "the same panorama")

    def sources_exist(self) -> None:
        for record in self._recording.records:
            missing = [str(path) for path in record.sources if not path.exists()]
            expect(not missing, f"sources of {record.id}", missing, "existing files")

    def _load(self, record: PanoramaRecord) -> Panorama:
        panorama: Panorama = attempt(f"load of {record.id}", record.load)
        expect(isinstance(panorama, Panorama), f"load of {record.id}", type(panorama).__name__, "Panorama")
        return panorama


def check_recording(importer: Importer, source: str | Path) -> Conformance:
    """Check a recording that an importer reads without errors, such as a small one in the tests of a plugin.

    Args:
        importer: The importer.
        source: The folder or file of the recording. All its panoramas are read.

    Returns:
        The result of every rule. In a test: `assert not check_recording(MyImporter(), "tests/recording").failed`.
    """
    return Conformance(f"importer {importer.name}", tuple(check_all(RecordingRules(importer, Path(source)).list())))
