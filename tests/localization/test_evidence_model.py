"""The role `evidence`: places by their frames, and what a component need not implement."""

import numpy as np

from salframe.framework.files.columns import read_columns, write_columns
from salframe.localization.evidence_model import EvidenceColumn, EvidenceModel, PlaceFrames

RNG = np.random.default_rng(3)


class Loudness(EvidenceModel):
    """Stores two arrays, and indexes what it gets."""

    name = "loudness"
    version = "1"
    columns = (EvidenceColumn("loudness", "level (dB)"),)
    arrays = ("level_db", "pitch_hz")

    def index(self, descriptions, places, T_world_pano):
        self.indexed = descriptions, places, T_world_pano

    def score(self, description, hypotheses):
        return {"loudness": np.zeros(len(hypotheses))}


def test_the_frames_of_places():
    """Three places with 2, 1 and 3 frames of a map with 8 frames, of which some belong to no place."""
    of_place = [[4, 0], [7], [2, 1, 5]]
    places = PlaceFrames(["a", "b"], np.array([0, 1, 0]), np.concatenate(of_place), np.array([0, 2, 3, 6]))
    assert len(places) == 3
    assert places.place.tolist() == [0, 0, 1, 2, 2, 2]
    assert places.padded.tolist() == [[4, 0, 0], [7, 7, 7], [2, 1, 5]]
    values = RNG.normal(size=8)
    assert places.max_of_frames(values).tolist() == [max(values[frame] for frame in frames) for frames in of_place]


def test_a_component_stores_its_arrays_and_no_others():
    first, last = ({"level_db": np.full(1, level), "labels": np.array(["bed"])} for level in (30.0, 40.0))
    component = Loudness()
    assert component.pack(first) == component.unpack(first) == {"level_db": first["level_db"]}
    assert component.join([first, last], np.tile(np.eye(4), (2, 1, 1))) == {"level_db": last["level_db"]}


def test_an_opened_map_is_indexed_by_what_was_packed(tmp_path):
    rows = [{"level_db": np.array([30.0]), "labels": np.array(["bed"])}, {"labels": np.array(["sofa"])}]
    write_columns(tmp_path / "rows", rows)
    places = PlaceFrames(["a"], np.array([0]), np.array([0, 1]), np.array([0, 2]))
    poses = np.tile(np.eye(4)[:3], (2, 1, 1))
    component = Loudness()
    component.open_index(read_columns(tmp_path / "rows"), places, poses)
    descriptions, indexed_places, indexed_poses = component.indexed
    assert [{name: array.tolist() for name, array in one.items()} for one in descriptions] == [{"level_db": [30.0]}, {}]
    assert indexed_places is places
    assert indexed_poses is poses
