"""Photo Sphere XMP: pictures that are cropped or tilted become upright panoramas with a mask."""

from __future__ import annotations

import io

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from scipy.spatial.transform import Rotation

from salframe.framework.errors import DataError
from salframe.panoramas import images
from salframe.panoramas.data_checks import picture_note
from salframe.panoramas.folder_format import FrameEntry, write_manifest
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.shot import open_panorama, open_photograph, read_panorama

HEIGHT = 256
SKY, GROUND, BALL = (120, 170, 230), (90, 80, 60), (250, 20, 20)
BALL_AT = np.array([np.cos(0.5) * np.cos(0.3), np.sin(0.5) * np.cos(0.3), np.sin(0.3)])
"""Azimuth 0.5 (to the left), elevation 0.3."""
NAMESPACES = (
    'xmlns:x="adobe:ns:meta/" xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" '
    'xmlns:GPano="http://ns.google.com/photos/1.0/panorama/"'
)
CROP = {
    "FullPanoWidthPixels": 512,
    "FullPanoHeightPixels": 256,
    "CroppedAreaImageWidthPixels": 256,
    "CroppedAreaImageHeightPixels": 100,
    "CroppedAreaLeftPixels": 128,
    "CroppedAreaTopPixels": 40,
}


def packet(form="attributes", head="", **values) -> bytes:
    """An XMP packet with GPano values as attributes or as elements."""
    if form == "attributes":
        inner = "<rdf:Description " + " ".join(f'GPano:{name}="{value}"' for name, value in values.items()) + "/>"
    else:
        elements = "".join(f"<GPano:{name}>{value}</GPano:{name}>" for name, value in values.items())
        inner = f"<rdf:Description>{elements}</rdf:Description>"
    return f"{head}<x:xmpmeta {NAMESPACES}><rdf:RDF>{inner}</rdf:RDF></x:xmpmeta>".encode()


def app1(content: bytes) -> bytes:
    return b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content


def with_segments(jpeg: bytes, *segments: bytes) -> bytes:
    return jpeg[:2] + b"".join(map(app1, segments)) + jpeg[2:]


def write(path, rgb, xmp: bytes | None = None):
    """Write a picture with an XMP packet."""
    stream = io.BytesIO()
    if path.suffix == ".png":
        info = PngInfo()
        if xmp:
            info.add_itxt("XML:com.adobe.xmp", xmp.decode())
        Image.fromarray(rgb).save(path, pnginfo=info)
        return path
    Image.fromarray(rgb).save(stream, "JPEG", quality=95, subsampling=0)
    content = stream.getvalue()
    path.write_bytes(with_segments(content, b"http://ns.adobe.com/xap/1.0/\0" + xmp) if xmp else content)
    return path


def scene(directions: np.ndarray) -> np.ndarray:
    """The colours of a world: sky above the horizon, ground below, and a ball in the direction BALL_AT."""
    colors = np.where(directions[..., 2:] > 0, SKY, GROUND)
    return np.where((directions @ BALL_AT > np.cos(np.radians(8)))[..., None], BALL, colors).astype(np.uint8)


def seen_by(pitch_deg: float, roll_deg: float, height: int = HEIGHT) -> np.ndarray:
    """The panorama of a camera whose front looks up by the pitch, and whose right side is lowered by the roll.

    Rotations about the axes of the camera: nose up is a negative turn about the left axis (y).
    """
    camera = Rotation.from_euler("YX", [-pitch_deg, roll_deg], degrees=True)
    rays = equirectangular_rays(height).reshape(-1, 3)
    return scene(camera.apply(rays).reshape(height, 2 * height, 3))


def test_the_camera_of_the_tests_follows_the_specification():
    """Pitch 30: the centre of the picture shows 30 deg above the horizon. Roll 30: the horizon rises to the right."""
    up = seen_by(30, 0)
    assert (up[HEIGHT // 2, HEIGHT] == SKY).all()
    assert (up[HEIGHT // 2 + HEIGHT * 32 // 180, HEIGHT] == GROUND).all()
    rolled = seen_by(0, 30)
    left, right = HEIGHT // 2, HEIGHT // 2 * 3
    assert (rolled[HEIGHT // 2 + 20, left] == SKY).all()
    assert (rolled[HEIGHT // 2 - 20, right] == GROUND).all()


@pytest.mark.parametrize(("pitch", "roll"), [(20, 0), (0, 35), (-40, 10), (15, 170), (89, 0), (0, -120), (5, 180)])
def test_a_tilted_picture_is_turned_upright(tmp_path, pitch, roll):
    write(tmp_path / "a.png", seen_by(pitch, roll), packet(PosePitchDegrees=pitch, PoseRollDegrees=roll))
    panorama = read_panorama(tmp_path / "a.png")
    error = np.abs(panorama.rgb.astype(int) - scene(equirectangular_rays(HEIGHT)).astype(int)).max(axis=2)
    assert (error > 10).mean() < 0.02  # the pixels at the horizon and around the ball
    assert panorama.valid is None
    assert panorama.notes == (
        f"levelled from pitch {pitch} deg and roll {roll} deg, as the Photo Sphere XMP metadata states",
    )


def test_range_and_ids_turn_with_the_picture(tmp_path):
    """The range of each pixel tells the elevation of its direction in the world."""
    camera = Rotation.from_euler("YX", [-25, 60], degrees=True)
    rays = equirectangular_rays(HEIGHT)
    world = camera.apply(rays.reshape(-1, 3)).reshape(rays.shape)
    write(tmp_path / "a.jpg", seen_by(25, 60), packet(PosePitchDegrees=25, PoseRollDegrees=60))
    images.write_range(tmp_path / "range.png", world[..., 2] + 2)
    images.write_ids(tmp_path / "ids.png", (world @ BALL_AT > 0.99).astype(np.int32) * 7)
    (tmp_path / "labels.json").write_text('{"7": "ball"}')
    panorama = read_panorama(*(tmp_path / name for name in ("a.jpg", "range.png", "ids.png", "labels.json")))
    np.testing.assert_allclose(panorama.range_m, rays[..., 2] + 2, atol=0.02)
    assert ((panorama.annotations.instance_id == 7) == (rays @ BALL_AT > 0.99)).mean() > 0.998


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("form", ["attributes", "elements"])
def test_a_crop_is_placed_on_the_sphere(tmp_path, suffix, form):
    whole = seen_by(0, 0)
    crop = whole[40:140, 128:384]
    path = write(tmp_path / f"a{suffix}", np.ascontiguousarray(crop), packet(form, **CROP))
    images.write_range(tmp_path / "range.png", np.full((100, 256), 3.0))
    for panorama in (read_panorama(path, tmp_path / "range.png"), open_panorama(path, tmp_path / "range.png").panorama):
        inside = np.zeros((256, 512), bool)
        inside[40:140, 128:384] = True
        np.testing.assert_array_equal(panorama.valid, inside)
        assert np.abs(panorama.rgb[inside].astype(int) - whole[inside]).mean() < 2
        assert not panorama.rgb[~inside].any()
        np.testing.assert_array_equal(np.isnan(panorama.range_m), ~inside)
        assert "crop of the full panorama (256 x 100 of 512 x 256 pixels)" in panorama.notes[0]


def test_a_crop_that_was_scaled_keeps_its_place(tmp_path):
    small = cv2.resize(seen_by(0, 0)[40:140, 128:384], (128, 50), interpolation=cv2.INTER_AREA)
    panorama = read_panorama(write(tmp_path / "a.png", small, packet(**CROP)))
    assert panorama.valid.shape == (128, 256)
    rows, columns = np.nonzero(panorama.valid)
    assert (rows.min(), rows.max() + 1, columns.min(), columns.max() + 1) == (20, 70, 64, 192)


def test_a_crop_may_be_tilted_too(tmp_path):
    crop = np.ascontiguousarray(seen_by(20, 0)[40:140, 128:384])
    panorama = read_panorama(write(tmp_path / "a.png", crop, packet(**CROP, PosePitchDegrees=20)))
    error = np.abs(panorama.rgb.astype(int) - scene(equirectangular_rays(HEIGHT))).max(axis=2)
    assert (error[panorama.valid] > 10).mean() < 0.05
    assert panorama.valid.mean() == pytest.approx(0.2, abs=0.05)


def test_the_extended_packet_counts(tmp_path):
    guid = b"0123456789ABCDEF0123456789ABCDEF"
    main = f'<x:xmpmeta {NAMESPACES} xmlns:n="http://ns.adobe.com/xmp/note/" n:HasExtendedXMP="{guid.decode()}"/>'
    extended = packet(PosePitchDegrees=20)
    parts = [(0, extended[:100]), (100, extended[100:])]
    segments = [
        b"http://ns.adobe.com/xmp/extension/\0"
        + guid
        + len(extended).to_bytes(4, "big")
        + offset.to_bytes(4, "big")
        + part
        for offset, part in parts
    ]
    jpeg = write(tmp_path / "a.jpg", seen_by(20, 0)).read_bytes()
    (tmp_path / "a.jpg").write_bytes(with_segments(jpeg, b"http://ns.adobe.com/xap/1.0/\0" + main.encode(), *segments))
    assert "pitch 20" in read_panorama(tmp_path / "a.jpg").notes[0]


def test_a_whole_upright_picture_stays_as_it_is(tmp_path):
    rgb = seen_by(0, 0)
    whole = dict(zip(CROP, (4096, 2048, 4096, 2048, 0, 0), strict=True))
    xmp = packet(ProjectionType="equirectangular", PoseHeadingDegrees=77, PosePitchDegrees="0.0", **whole)
    panorama = read_panorama(write(tmp_path / "a.png", rgb, xmp))
    np.testing.assert_array_equal(panorama.rgb, rgb)
    assert (panorama.valid, panorama.notes) == (None, ())


ENTITIES = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("xmp", "said"),
    [
        (packet(**{**CROP, "CroppedAreaLeftPixels": 300}), "column 300 and row 40, expected a crop inside"),
        (packet(**{**CROP, "CroppedAreaTopPixels": -5}), "row -5, expected a crop inside"),
        (packet(**{**CROP, "FullPanoWidthPixels": 100}), "full panorama with width = 2 x height"),
        (
            packet(**{**CROP, "FullPanoHeightPixels": "nan"}),
            "property FullPanoHeightPixels with the value 'nan', expected a number",
        ),
        (
            packet(**{**CROP, "FullPanoHeightPixels": "1e99"}),
            "property FullPanoHeightPixels with the value '1e99', expected a number",
        ),
        (packet(**{**CROP, "CroppedAreaImageHeightPixels": 0}), "a crop of 256 x 0"),
        (packet(**{**CROP, "CroppedAreaImageWidthPixels": 150}), "expected the aspect ratio of the picture, 256 x 100"),
        (packet(**{k: v for k, v in CROP.items() if "Left" not in k}), "no property CroppedAreaLeftPixels"),
        (packet(PosePitchDegrees=91), "PosePitchDegrees with the value '91', expected a number from -90 to 90"),
        (packet(PoseRollDegrees="left"), "PoseRollDegrees with the value 'left'"),
        (packet(ProjectionType="cylindrical"), "the ProjectionType 'cylindrical', expected 'equirectangular'"),
        (packet(head=ENTITIES, PosePitchDegrees="&b;"), "invalid XML"),
        (packet(head='<!DOCTYPE x SYSTEM "file:///etc/passwd">', PosePitchDegrees=1), "invalid XML"),
        (packet(PosePitchDegrees=1)[:-5], "invalid XML"),
    ],
)
def test_xmp_that_cannot_be_right_is_one_line(tmp_path, xmp, said):
    write(tmp_path / "a.jpg", np.full((100, 256, 3), 90, np.uint8), xmp)
    with pytest.raises(DataError, match=r"a\.jpg: the Photo Sphere XMP metadata has .*exiftool") as caught:
        read_panorama(tmp_path / "a.jpg")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_range_image_of_the_full_sphere_contradicts_a_crop(tmp_path):
    write(tmp_path / "a.jpg", np.full((100, 256, 3), 90, np.uint8), packet(**CROP))
    images.write_range(tmp_path / "range.png", np.full((256, 512), 3.0))
    with pytest.raises(DataError, match=r"range\.png is 512 x 256, expected 256 x 100, the size of .*a\.jpg"):
        read_panorama(tmp_path / "a.jpg", tmp_path / "range.png")


def test_a_panorama_is_no_photograph(tmp_path):
    xmp = packet(ProjectionType="equirectangular", **CROP)
    write(tmp_path / "a.jpg", np.full((100, 256, 3), 90, np.uint8), xmp)
    with pytest.raises(
        DataError, match="is an equirectangular panorama according to its XMP metadata, expected a photograph"
    ):
        open_photograph(tmp_path / "a.jpg", fov_deg=60)


def test_a_folder_levels_its_frames_unless_their_poses_are_tilted(tmp_path):
    write(tmp_path / "a.png", seen_by(20, 0), packet(PosePitchDegrees=20))
    tilted = np.eye(4)
    tilted[:3, :3] = Rotation.from_euler("Y", -20, degrees=True).as_matrix()
    poses = {"upright": np.eye(4), "tilted": tilted}
    frames = [
        FrameEntry(id=name, role="map", place="hall", pose=tuple(pose.ravel()), rgb="a.png")
        for name, pose in poses.items()
    ]
    write_manifest(tmp_path, [*frames, FrameEntry(id="q", role="query", rgb="a.png")], truth={})
    folder = Folder(tmp_path)
    upright, kept, query = (folder.load(frame) for frame in folder.manifest.frames)
    np.testing.assert_array_equal(query.rgb, upright.rgb)
    np.testing.assert_array_equal(kept.rgb, seen_by(20, 0))
    assert upright.notes[0].startswith("levelled")
    assert kept.notes[0].startswith("not levelled")


def test_a_note_on_a_few_of_many_frames(tmp_path):
    write(tmp_path / "a.png", seen_by(20, 0), packet(PosePitchDegrees=20))
    tilted, plain = read_panorama(tmp_path / "a.png"), read_panorama(write(tmp_path / "b.png", seen_by(0, 0)))
    assert picture_note([plain] * 9) is None
    assert picture_note([plain] * 8 + [tilted]) == (
        "image of a.png: levelled from pitch 20 deg and roll 0 deg, as the Photo Sphere XMP metadata states "
        "(the reader changed 1 of 3 checked images)"
    )
