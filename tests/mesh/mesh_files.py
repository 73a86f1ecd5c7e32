"""Small meshes written by hand in the three formats, so that nothing but the reader under test knows Open3D."""

import json
import struct
from pathlib import Path

import cv2
import numpy as np

RED, BLUE, GREEN = (250, 10, 10), (10, 10, 250), (10, 250, 10)


def texture():
    """(64, 64, 3) RGB: red above, blue below, its right quarter green."""
    image = np.zeros((64, 64, 3), np.uint8)
    image[:32], image[32:] = RED, BLUE
    image[:, 48:] = GREEN
    return image


WALL = np.array([[2, 1, -1], [2, -1, -1], [2, -1, 1], [2, 1, 1]], float)
"""A square 2 m ahead of the origin, seen from there from its lower left corner on, counter-clockwise."""
WALL_UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)


def write_obj(folder: Path):
    """The wall with its texture, and a plain ceiling 1.5 m up of the colour (51, 102, 153)."""
    cv2.imwrite(str(folder / "wall.png"), texture()[..., ::-1])
    (folder / "room.mtl").write_text("newmtl wall\nKd 1 1 1\nmap_Kd wall.png\nnewmtl plain\nKd 0.2 0.4 0.6\n")
    corners = [*WALL, [-3, -3, 1.5], [3, -3, 1.5], [3, 3, 1.5], [-3, 3, 1.5]]
    lines = ["mtllib room.mtl", *(f"v {x} {y} {z}" for x, y, z in corners), *(f"vt {u} {v}" for u, v in WALL_UV)]
    lines += ["usemtl wall", "f 1/1 2/2 3/3 4/4", "usemtl plain", "f 5 6 7 8"]
    (folder / "room.obj").write_text("\n".join(lines) + "\n")


def write_glb(folder: Path):
    """The wall as glTF has it: y up, texture inside, coordinates from the upper left, moved into place by its node."""
    points = np.stack([WALL[:, 0], WALL[:, 2], -WALL[:, 1]], 1).astype(np.float32) - np.array([10, 0, 0], np.float32)
    uv = np.stack([WALL_UV[:, 0], 1 - WALL_UV[:, 1]], 1).astype(np.float32)
    faces = np.array([0, 1, 2, 0, 2, 3], np.uint16)
    png = cv2.imencode(".png", texture()[..., ::-1])[1].tobytes()
    views, binary = [], b""
    for blob in (points.tobytes(), uv.tobytes(), faces.tobytes(), png):
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(blob)})
        binary += blob + b"\0" * (-len(blob) % 4)
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [10, 0, 0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 4,
                "type": "VEC3",
                "min": points.min(0).tolist(),
                "max": points.max(0).tolist(),
            },
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<III", 0x46546C67, 2, 12 + 8 + len(text) + 8 + len(binary))
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    (folder / "room.glb").write_bytes(head + chunks)


def write_ply(path: Path, vertices_m, faces, colors=None):
    """Binary PLY of faces (F, 3 or 4) with a colour (V, 3) at each vertex, or none."""
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")] + [
        (name, "u1") for name in ("red", "green", "blue") if colors is not None
    ]
    table = np.zeros(len(vertices_m), fields)
    for i, name in enumerate("xyz"):
        table[name] = np.asarray(vertices_m)[:, i]
    if colors is not None:
        for i, name in enumerate(("red", "green", "blue")):
            table[name] = np.asarray(colors)[:, i]
    faces = np.asarray(faces)
    rows = np.zeros(len(faces), [("n", "u1"), ("at", "<i4", (faces.shape[1] if faces.ndim == 2 else 3,))])
    if len(faces):
        rows["n"], rows["at"] = faces.shape[1], faces
    names = {"<f4": "float", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(table)}",
        *(f"property {names[t]} {n}" for n, t in fields),
    ]
    header += [f"element face {len(rows)}", "property list uchar int vertex_indices", "end_header\n"]
    path.write_bytes("\n".join(header).encode() + table.tobytes() + rows.tobytes())
