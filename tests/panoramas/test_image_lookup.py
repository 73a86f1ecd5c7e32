"""Images of a folder, found by any path that leads to them."""

from __future__ import annotations

import json
import unicodedata
from pathlib import Path

import pytest
from tiny_folder import write_tiny_folder

from salframe.framework.errors import DataError
from salframe.panoramas.image_lookup import find_frame_image
from salframe.panoramas.opening import find_image

IMAGE = "frames/kitchen-query.range.png"


@pytest.fixture
def folder(tmp_path) -> Path:
    return write_tiny_folder(tmp_path / "case" / "data")


def rename(folder: Path, change) -> None:
    """Change the names of all images in the manifest."""
    content = json.loads((folder / "manifest.json").read_text())
    for frame in content["frames"]:
        frame.update({key: change(frame[key]) for key in ("rgb", "range", "instances")})
    (folder / "manifest.json").write_text(json.dumps(content))


def found(path: Path) -> tuple[str, str]:
    image = find_frame_image(path)
    return image.frame.id, image.key


def test_images_that_are_links_into_a_store(folder):
    store = folder.parent / "store"
    store.mkdir()
    for file in (folder / "frames").iterdir():
        file.rename(store / file.name)
        file.symlink_to(store / file.name)
    assert found(folder / IMAGE) == ("kitchen-query", "range")


def test_frames_that_link_to_the_same_file_are_told_apart_by_their_path(folder):
    image, other = folder / IMAGE, folder / "frames/bedroom-query.range.png"
    other.unlink()
    other.symlink_to(image)
    assert found(image) == ("kitchen-query", "range")
    assert found(other) == ("bedroom-query", "range")
    (link := folder / "link.png").symlink_to(image)
    with pytest.raises(
        DataError,
        match=r"link\.png is the image of 2 frames of .*manifest\.json \(.*\), expected the image of one frame",
    ):
        find_frame_image(link)


def test_a_link_to_the_folder_or_from_outside(folder, tmp_path):
    (tmp_path / "link").symlink_to(folder)
    assert found(tmp_path / "link" / IMAGE) == ("kitchen-query", "range")
    (tmp_path / "latest.png").symlink_to(folder / IMAGE)
    assert found(tmp_path / "latest.png") == ("kitchen-query", "range")


@pytest.mark.parametrize("change", ["./{}", ".//{}", "frames/../{}", "../data/{}"])
def test_names_with_dots_in_the_manifest(folder, monkeypatch, change):
    rename(folder, change.format)
    monkeypatch.chdir(folder)
    for path in (folder / IMAGE, Path(IMAGE), Path("./frames") / "." / Path(IMAGE).name, Path("../data") / IMAGE):
        assert found(path) == ("kitchen-query", "range")
    assert find_image(Path(IMAGE))[1] == "kitchen-query"


def test_absolute_names_in_the_manifest(folder):
    rename(folder, lambda name: str(folder / name))
    assert found(folder / IMAGE) == ("kitchen-query", "range")


def test_images_outside_of_the_folder_of_the_manifest(folder):
    (folder / "frames").rename(folder.parent / "images")
    rename(folder, lambda name: "../images/" + Path(name).name)
    (broken := folder.parent / "broken").mkdir()
    (broken / "manifest.json").write_text("{}")
    assert found(folder.parent / "images" / Path(IMAGE).name) == ("kitchen-query", "range")
    assert found(folder / ".." / "images" / Path(IMAGE).name) == ("kitchen-query", "range")


def test_names_in_another_unicode_normalization(folder):
    composed, decomposed = (unicodedata.normalize(form, "frames/k\u00fcche.png") for form in ("NFC", "NFD"))
    assert composed != decomposed
    (folder / IMAGE).rename(folder / composed)
    rename(folder, lambda name: composed if name == IMAGE else name)
    assert found(folder / composed) == found(folder / decomposed) == ("kitchen-query", "range")


def test_an_image_that_no_manifest_names(folder, tmp_path):
    assert find_frame_image(folder / "frames" / "absent.png") is None
    assert find_frame_image(tmp_path / "elsewhere" / "a.png") is None
