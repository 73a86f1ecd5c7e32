"""Furniture meshes of Sweet Home 3D's libraries (.sh3f), an alternative to the parametric meshes."""

from __future__ import annotations

import re
import tempfile
import zipfile
import zlib
from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from salframe.framework.errors import DataError, RequirementMissing
from salframe.framework.files.bounded import check_regular
from salframe_house.looks import GLASS
from salframe_house.mesh import Mesh
from salframe_house.object_class import Size
from salframe_house.scene import Material
from salframe_house.textures import image_texture

Part = Literal["training", "held-out"]

LISTING = "PluginFurnitureCatalog.properties"
MAX_MODEL_BYTES = 1_000_000
"""Maximum size of an OBJ file: about 15,000 triangles. 90 % of the models are smaller."""
_MAX_LIBRARY_BYTES = 1 << 32

SHARE = 0.5
"""Fraction of the objects of a class that use a catalogue mesh, if the catalogue has models of the class."""

_DEFAULT_RGBA = (0.8, 0.8, 0.8, 1.0)

NAMES = {
    "armchair": r"(modern |rattan |winchester )?armchair",
    "baby bed": r"baby bed|crib|child bed",
    "bar table": r"bar table",
    "bathroom vanity": r"(double )?vanity",
    "bathtub": r"bath|island bath",
    "bed": r"(iron |captain's |day )?bed",
    "bench": r"(piano |concrete |painted )?bench",
    "bookshelf": r"(full )?bookcase|vertical shelves",
    "box": r"(open )?(cardboard )?box|crate",
    "cabinet": r"chest|cupboard|small lower cabinet|drawers cabinet|trunck",
    "chair": r"(oak |plastic |osaka |ryokan |cafe |teck |folding )?chair( with cushion)?",
    "clock": r"clock",
    "coat rack": r"clothes rack",
    "coffee machine": r"coffee (brewer|machine|maker)",
    "coffee table": r"coffee table",
    "conference table": r"technical table",
    "desk": r"(wooden )?desk|desk table|workbench",
    "dining table": r"((oak|black|wooden|wooden alder|wooden teak) )?table|table (on trestles|with tablecloth)",
    "dishwasher": r"dishwasher",
    "dresser": r"dresser with drawers|dressing table|changing table",
    "drying rack": r"clothes horse",
    "file cabinet": r"filing cabinet",
    "fire extinguisher": r"extinguisher",
    "fireplace": r"fireplace|chimney",
    "floor lamp": r"pedestal vase lamp",
    "flowers": r"flowers|tulips|orchids|white lily|vase",
    "kettle": r"espresso kettle|teapot",
    "kitchen counter": r"island|lower cabinet",
    "kitchen cabinet": r"upper (shelves )?cabinet|small upper cabinet",
    "kitchen sink": r"sink cabinet",
    "lamp": r"(desk |little )?lamp",
    "laptop": r"laptop|apple ibook",
    "laundry basket": r"clothes basket",
    "locker": r"locked locker",
    "microwave": r"microwave",
    "monitor": r"screen|apple imac",
    "nightstand": r"bedside table",
    "ottoman": r"puff|armchair ottoman",
    "oven": r"(double |small )?oven|(large )?stove|cooker",
    "piano": r"upright piano",
    "plant": r"(little |indoor |decorative |succulent |spider )?plant|ficus|yucca|bamboo|spathiphyllum|cactus|"
    r"bonsai tree",
    "printer": r"inkjet printer and scanner",
    "projector": r"video projector",
    "radiator": r"radiator",
    "recycling bin": r"recycling bin",
    "refrigerator": r"(large )?fridge|refrigerator",
    "rug": r"oriental rug|tatami",
    "shower": r"shower stall",
    "side table": r"round table|glass table",
    "sink": r"washbasin|small lavatory",
    "sofa": r"(burlap |clear |rattan |winchester )?sofa( seats)?|(futon )?couch|(opened )?convertible sofa bz",
    "stool": r"(bar )?stool|bar chair",
    "storage shelf": r"shelves",
    "telephone": r"phone|wireless phone",
    "toilet": r"toilets unit",
    "toilet paper": r"toilet paper dispenser",
    "towel": r"towel|towel rack",
    "trash can": r"(bullet |park )?trash ?can|dustbin",
    "treadmill": r"treadmill",
    "tv": r"wall flat tv|tv|tv :",
    "tv stand": r"tv stand|television cabinet",
    "umbrella stand": r"umbrella",
    "urinal": r"urinal",
    "wall lamp": r"wall light|wall lamp artwork",
    "wardrobe": r"wardrobe|high cabinet",
    "washing machine": r"(clothes )?washing machine|dryer machine",
    "water cooler": r"water cooler",
    "whiteboard": r"white board",
}
"""Mapping from each object class to a regular expression. A model belongs to the class if its English name, in lower
case and without digits, matches."""


@dataclass(frozen=True)
class Asset:
    """A furniture model of a library.

    Attributes:
        id: Unique identifier.
        label: Object class.
        creator: Author of the model.
        licence: Licence of the model.
        archive: Path of the library.
        model: Path of the model inside the library.
        rotation: Row-major 3 x 3 rotation from the axes of the model file to x right, y up, z to the front.
    """

    id: str
    label: str
    creator: str
    licence: str
    archive: Path
    model: str
    rotation: tuple[float, ...]


class Catalogue:
    """The models of all .sh3f libraries in a folder that belong to a class of `furniture.CLASSES`.

    Args:
        folder: Folder of the libraries, searched recursively.
        part: Models to use: "training"; "held-out", one in five models of each class; or None for all.

    Attributes:
        assets: Mapping from each object class to its models.

    Raises:
        DataError: The folder contains no library.
        RequirementMissing: trimesh is not installed.
    """

    def __init__(self, folder: Path, part: Part | None = None) -> None:
        _trimesh()
        libraries = sorted(folder.rglob("*.sh3f"))
        if not libraries:
            raise DataError(f"{folder} contains no .sh3f library; expected the furniture libraries of Sweet Home 3D")
        by_label: dict[str, list[Asset]] = defaultdict(list)
        for asset in sorted(
            (asset for library in libraries for asset in read_library(library)),
            key=lambda asset: zlib.crc32(asset.id.encode()),
        ):
            by_label[asset.label].append(asset)
        self.assets = {
            label: [
                asset
                for number, asset in enumerate(assets)
                if part is None or (number % 5 == 2) == (part == "held-out")
            ]
            for label, assets in by_label.items()
        }

    def choose(self, label: str, seed: int) -> Asset | None:
        """Return the model of an object with this label and seed; None if the parametric mesh is used."""
        rng = np.random.default_rng((seed, 3))
        models = self.assets.get(label, ())
        return models[rng.integers(len(models))] if models and rng.random() < SHARE else None

    def mesh(self, label: str, size_m: Size, seed: int) -> Mesh | None:
        """Return the selected model, scaled to `size_m`, in the object frame (see `ObjectClass`).

        Returns:
            None if the parametric mesh is used.
        """
        asset = self.choose(label, seed)
        if asset is None:
            return None
        mesh = asset_mesh(asset)
        return Mesh(mesh.vertices_m * size_m, mesh.triangles, mesh.uv_m, mesh.material_index, mesh.materials)


def read_library(path: Path) -> list[Asset]:
    """Read the models of a library that belong to an object class and are at most `MAX_MODEL_BYTES` large.

    Raises:
        DataError: The file is not a .sh3f library.
    """
    try:
        check_regular(path, _MAX_LIBRARY_BYTES)
        with zipfile.ZipFile(path) as archive:
            sizes = {item.filename: item.file_size for item in archive.infolist()}
            text = archive.read(LISTING).decode("latin-1")
    # zipfile raises NotImplementedError for an unknown compression, and RuntimeError for an encrypted member.
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, KeyError, OSError, ValueError) as error:
        raise DataError(f"{path} is not a furniture library of Sweet Home 3D: {error}") from None
    values = dict(line.split("=", 1) for line in text.splitlines() if "=" in line and not line.startswith("#"))
    assets = []
    for number in sorted(int(key[3:]) for key in values if key.startswith("id#")):
        model = values[f"model#{number}"].lstrip("/")
        label = class_of(values[f"name#{number}"])
        if label is None or sizes.get(model, MAX_MODEL_BYTES + 1) > MAX_MODEL_BYTES:
            continue
        rotation = tuple(float(value) for value in values.get(f"modelRotation#{number}", "1 0 0 0 1 0 0 0 1").split())
        creator = values.get(f"creator#{number}") or values.get("provider", "")
        assets.append(Asset(values[f"id#{number}"], label, creator, values.get("license", ""), path, model, rotation))
    return assets


def class_of(name: str) -> str | None:
    """Return the object class of an English model name; None if the name belongs to no class."""
    plain = " ".join(re.sub(r"[0-9]", " ", name.lower()).split())
    return next((label for label, pattern in NAMES.items() if re.fullmatch(pattern, plain)), None)


@lru_cache(maxsize=512)
def asset_mesh(asset: Asset) -> Mesh:
    """Load a model into the unit box: footprint centred on the origin, base at z = 0, front along +x.

    Raises:
        DataError: The model cannot be read.
    """
    parts = _read_parts(asset)
    front_left_up = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]) @ np.reshape(asset.rotation, (3, 3))
    vertices = np.concatenate([np.asarray(part.vertices) for part in parts]) @ front_left_up.T
    low, high = vertices.min(0), vertices.max(0)
    vertices = (vertices - [*((low + high) / 2)[:2], low[2]]) / np.maximum(high - low, 1e-6)
    counts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    materials: dict[Material, int] = {}
    index = [np.full(len(part.faces), materials.setdefault(_look(part), len(materials))) for part in parts]
    return Mesh(
        vertices,
        np.concatenate([part.faces + count for part, count in zip(parts, counts, strict=True)]),
        np.concatenate([_corners_uv(part) for part in parts]),
        np.concatenate(index),
        tuple(materials),
    )


def _read_parts(asset: Asset) -> list[Any]:
    """Read the parts of a model, one per material."""
    folder = asset.model.rpartition("/")[0] + "/"
    with tempfile.TemporaryDirectory() as directory, zipfile.ZipFile(asset.archive) as archive:
        for name in archive.namelist():
            if name.startswith(folder):
                archive.extract(name, directory)
        try:
            scene = _trimesh().load_scene(Path(directory) / asset.model, group_material=True, split_object=False)
            parts = [part for part in scene.geometry.values() if len(part.faces)]
            for part in parts:
                image = getattr(_material(part), "image", None)
                if image is not None:
                    image.load()  # the temporary folder is deleted when this function returns
        except (ValueError, KeyError, IndexError, OSError) as error:
            raise DataError(f"{asset.archive}: cannot read model {asset.model}: {error}") from None
    if not parts:
        raise DataError(f"{asset.archive}: model {asset.model} contains no triangles")
    return parts


def _corners_uv(part: Any) -> np.ndarray:
    """Return the texture coordinates at the corners of the triangles, (F, 3, 2)."""
    uv = getattr(part.visual, "uv", None)
    return np.zeros((len(part.faces), 3, 2)) if uv is None else np.asarray(uv)[part.faces]


def _material(part: Any) -> Any:
    """Return the material of a part as read by trimesh; None if the model has none."""
    return getattr(part.visual, "material", None)


def _look(part: Any) -> Material:
    """Convert a catalogue material, whose colours are display values (gamma 2.2), to a material with linear albedo."""
    material = _material(part)
    red, green, blue, opacity = np.asarray(material.diffuse) / 255 if material else _DEFAULT_RGBA
    if opacity < 0.5:
        return GLASS
    if material is None or material.image is None:
        return Material("plastic", _albedo(np.array([red, green, blue]) ** 2.2))
    pixels = np.asarray(material.image.convert("RGB"))[::-1]
    return Material(image_texture(pixels), _albedo(((pixels / 255) ** 2.2).mean((0, 1))))


def _albedo(linear_rgb: np.ndarray) -> tuple[float, float, float]:
    red, green, blue = linear_rgb.clip(0.02, 0.8).round(3).tolist()
    return red, green, blue


def _trimesh() -> Any:
    """Import trimesh."""
    try:
        import trimesh
    except ImportError:
        raise RequirementMissing(
            "reading Sweet Home 3D furniture requires trimesh; install it with: pip install 'salframe[assets]'"
        ) from None
    return trimesh
