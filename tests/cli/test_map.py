"""`salframe map`: build, add, remove, merge, show, route, query, export, and what a user gets wrong."""

from __future__ import annotations

import json
import os
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import networkx as nx
import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import run
from PIL import Image

from salframe.evaluation.tables.text import format_bytes
from salframe.framework.components.installation import folder_bytes
from salframe.framework.components.registry import registry
from salframe.topology.store import open_topology
from salframe.topology.topological_map import PartSource

TOPOLOGY = Path(__file__).parent.parent / "topology"


@pytest.fixture
def rooms(fakes, monkeypatch: pytest.MonkeyPatch):
    """The fakes with doors, and our planners."""
    monkeypatch.syspath_prepend(TOPOLOGY)
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,doored_plugin,salframe_engines,salframe_planners")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(TOPOLOGY), os.environ["PYTHONPATH"]]))
    registry.cache_clear()


@pytest.fixture
def built(rooms):
    done = run("map", "build", "doored", "-o", "map", "--method", "reader")
    assert done.code == 0, done.err
    return done


def test_build_writes_both_maps_whole(built, tmp_path):
    assert (
        built.out.splitlines()[0] == f"map: {format_bytes(folder_bytes(tmp_path / 'map'))}, "
        "5 scene nodes, 4 transition nodes, 14 edges"
    )  # frames and doors of a room, doors and doors
    (parts,) = (tmp_path / "map").glob("parts-*")
    assert sorted(path.name for path in (tmp_path / "map").iterdir()) == ["map.json", parts.name]
    names = {"topology.json", "nodes", "edges", "floors.npz", "method.json", "frames", "scenes"}
    assert {path.name for path in parts.iterdir()} == names
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    assert run("map", "build", "doored", "-o", "map", "--method", "reader", "--central-nodes").code == 0
    assert open_topology(tmp_path / "map").parameters.choose
    assert run("localize", "map", "query-1-0", "--data", "doored").code == 0


def test_a_map_is_added_to_merged_and_taken_from(built):
    assert run("map", "build", "doored", "-o", "new", "--method", "reader", "--set", "data.rooms=3").code == 0
    done = run("map", "add", "new", "doored")
    assert done.out.splitlines() == [
        "added: room-3, room-4",
        "replaced: room-0, room-1, room-2",
        "new: 5 places, 5 frames",
    ]
    assert run("map", "route", "new", "room-0", "room-4", "--json").json["nodes"][-1] == "map-4"
    assert run("map", "build", "upstairs", "-o", "above", "--method", "reader").code == 0
    done = run("map", "merge", "new", "above", "--json").json
    assert done == {
        "added": [f"upper-room-{room}" for room in range(5)],
        "replaced": [],
        "removed": [],
        "places": 10,
        "frames": 10,
        "notes": [
            "the 2 floors at z = 0.00, 3.00 m are not connected: add stairs or lifts with `salframe map connect`"
        ],
    }
    done = run("map", "remove", "new", *(f"upper-room-{room}" for room in range(5)), "room-3")
    assert done.out.splitlines()[:2] == [
        "removed: room-3, upper-room-0, upper-room-1, upper-room-2, upper-room-3, upper-room-4",
        "new: 4 places, 4 frames",
    ]
    assert "  the region room-4 cannot be reached from the other regions: no door" in done.out


def test_route_prints_lengths_azimuths_and_turns(built):
    """Frames stand 4 m apart at y = 0, doors 0.7 m south of that: the way is the taut string between the jambs."""
    done = run("map", "route", "map", "room-0", "map-2", "--heading", "90", "--json").json
    assert done["nodes"][0] == "map-0"
    assert done["nodes"][-1] == "map-2"
    assert done["length_m"] == pytest.approx(sum(step["length_m"] for step in done["steps"]))
    assert 8.0 < done["length_m"] < 8.4
    heading_deg, x, y = 90.0, 0.0, 0.0
    for step in done["steps"]:
        assert (heading_deg + step["turn_deg"] - step["azimuth_deg"] + 180) % 360 == pytest.approx(180)
        heading_deg = step["azimuth_deg"]
        x, y = (at + step["length_m"] * f(np.radians(heading_deg)) for at, f in ((x, np.cos), (y, np.sin)))
    assert (x, y) == pytest.approx((8.0, 0.0), abs=1e-9)
    said = run("map", "route", "map", "room-0", "map-2", "--heading", "90").out.splitlines()
    assert said[0] == f"from map-0 to map-2: {done['length_m']:.2f} m"
    first = done["steps"][0]
    assert said[1] == f"   1. turn right {-first['turn_deg']:.0f} deg, walk {first['length_m']:.1f} m to {first['to']}"
    assert (
        run("map", "route", "map", "room-0", "map-2", "--planner", "floyd-warshall", "--heading", "90", "--json").json
        == done
    )


def test_query_finds_the_nearest_node_and_the_way_from_the_estimated_heading(built):
    """The reader answers with the pose of its room's reference frame: at (4, 0), looking along x."""
    done = run("map", "query", "map", "query-1-0", "--data", "doored", "--to", "room-3", "--json").json
    assert (done["status"], done["node"], done["distance_m"], done["heading_deg"]) == ("ok", "map-1", 0.0, 0.0)
    assert done["route"]["nodes"][0] == "here"
    assert done["route"]["nodes"][-1] == "map-3"
    walked = [step for step in done["route"]["steps"] if step["length_m"]]
    assert walked[0]["turn_deg"] == pytest.approx(walked[0]["azimuth_deg"])
    said = run("map", "query", "map", "query-1-0", "--data", "doored").out
    assert "pose: x 4.00 m, y 0.00 m, yaw 0.0 deg" in said
    assert "nearest node: map-1, 0.00 m away" in said


def test_a_query_that_is_not_localized_is_told(rooms):
    assert run("map", "build", "doored", "-o", "map", "--method", "reader", "--set", "refuse_in=1").code == 0
    done = run("map", "query", "map", "query-1-0", "--data", "doored")
    assert done.code == 0
    assert done.out.splitlines() == ["status: low-score", "nearest node: unknown"]
    done = run("map", "query", "map", "query-1-0", "--data", "doored", "--to", "room-3")
    assert (done.code, done.err) == (1, "")
    assert done.out.splitlines() == [
        "status: low-score",
        "nearest node: unknown",
        "no route to room-3: the query query-1-0 was not localized (low-score)",
    ]


def test_a_position_is_printed_without_a_route(rooms):
    """The map has no doors, so that no edge joins its rooms."""
    assert run("map", "build", "rooms", "-o", "map", "--method", "reader").code == 0
    query = "map", "query", "map", "query-1-0", "--data", "rooms"
    for goal, reason in (
        ("room-3", "no route from here to room-3: the map has no path between them"),
        ("rom-3", "no route to rom-3: unknown node or place 'rom-3', did you mean 'room-3'?"),
    ):
        done = run(*query, "--to", goal)
        assert done.code == 1
        printed = done.out.splitlines()
        position = next(i for i, line in enumerate(printed) if line.startswith("pose: x 4.00 m, y 0.00 m"))
        assert printed[position + 1].startswith("nearest node: map-1")
        assert printed[-1].startswith(reason)
        done = run(*query, "--to", goal, "--json")
        assert (done.code, done.json["pose"]["x_m"], done.json["route"]) == (1, 4.0, None)
        assert done.json["no_route"].startswith(reason)
    done = run(*query, "--json")
    assert (done.code, done.json["no_route"]) == (0, None)


def test_show_and_export(built, tmp_path):
    assert run("map", "show", "map").out.splitlines() == ["map/map.png", "not calibrated"]
    assert min(Image.open(tmp_path / "map" / "map.png").size) > 200
    assert run("map", "show", "map", "-o", "other.png").code == 0
    assert Image.open(tmp_path / "other.png").format == "PNG"
    assert run("map", "export", "map", "map.graphml").code == run("map", "export", "map", "map.geojson").code == 0
    assert len(nx.read_graphml(tmp_path / "map.graphml")) == 9
    features = json.loads((tmp_path / "map.geojson").read_text())["features"]
    layers = [feature["properties"]["layer"] for feature in features]
    assert (layers.count("node"), layers.count("edge"), layers.count("place")) == (9, 14, 5)
    for name in ("map.json", "map.yaml", "map.svg"):
        assert run("map", "export", "map", name).code == 0
    places, schema = (json.loads((tmp_path / name).read_text()) for name in ("map.json", "map.schema.json"))
    jsonschema.validate(places, schema)
    assert len(places["places"]) == 5
    assert ElementTree.parse(tmp_path / "map.svg").getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert run("map", "export", "map", "map.svg", "--anchor", "52,13,0").code != 0
    assert run("map", "export", "map", "map.parquet").code == 0
    rows = pq.read_table(tmp_path / "map.parquet").to_pylist()
    assert [(row["frame"], row["place"], row["kind"]) for row in rows][1] == ("map-1", "room-1", "scene")
    assert [row["room"] for row in rows] == [[number, 0] for number in range(5)]
    assert [row["T_world_pano"][3::4] for row in rows] == [[4.0 * number, 0, 0, 1] for number in range(5)]


def test_build_and_map_build_are_one_command(built, tmp_path):
    def parts(directory):
        return json.loads((tmp_path / directory / "map.json").read_text())["sha256"]

    done = run("build", "doored", "-o", "other", "--method", "reader")
    assert done.out.splitlines()[0] == built.out.splitlines()[0].replace("map: ", "other: ")
    assert parts("other") == parts("map")
    assert run("build", "doored", "-o", "other", "--method", "reader", "--no-topology").out.endswith(", no topology\n")
    assert set(parts("map")) > set(parts("other"))
    done = run("map", "route", "other", "room-0", "room-1")
    assert (done.code, done.err) == (
        2,
        "error: other contains no topology: build the map again, from data with floor masks or range, and "
        "without --no-topology\n",
    )


def test_data_without_floors_give_a_map_without_topology(rooms):
    done = run("map", "build", "maskless", "-o", "map", "--method", "reader")
    reason = "the data have neither floor masks nor range images to derive floors from, expected one of them"
    assert (done.code, done.err) == (0, f"warning: the map has no topology (graph for routes): {reason}\n")
    assert done.out.endswith(", no topology\n")
    assert run("localize", "map", "query-1-0", "--data", "doored").code == 0
    done = run("map", "query", "map", "query-1-0", "--data", "doored", "--json").json
    assert (done["status"], done["node"], done["heading_deg"]) == ("ok", None, 0.0)
    done = run("map", "query", "map", "query-1-0", "--data", "doored", "--to", "room-3")
    assert (done.code, done.err) == (1, "")
    assert "pose: x 4.00 m, y 0.00 m, yaw 0.0 deg" in done.out
    reason = "the map has no topology, which routes need: build the map from data with floor masks or range"
    assert done.out.endswith(f"no route to room-3: {reason}\n")


@pytest.mark.parametrize("options", [(), ("--central-nodes",), ("--no-topology",)])
def test_two_floors_of_one_height_are_refused(rooms, tmp_path, options):
    done = run("map", "build", "storeys", "-o", "map", "--method", "reader", "--set", "data.height_m=0", *options)
    assert done.code == 2
    assert done.err.startswith(
        "error: two floors whose masks overlap or touch have z_m = 0 (one with the place 'room-0', "
    )
    assert done.err.endswith("), expected a different z_m for each floor\n")
    assert not (tmp_path / "map").exists()


def test_a_dataset_without_frames_has_one_scene_node_a_region_and_no_localizer(rooms, tmp_path):
    done = run("map", "build", "frameless", "-o", "map", "--method", "reader")
    assert ", 5 scene nodes, 4 transition nodes, " in done.out.splitlines()[0]
    assert run("map", "route", "map", "room-0", "room-4", "--json").json["nodes"][0] == "room-0"
    done = run("map", "query", "map", "query-1-0", "--data", "doored")
    message = (
        "error: the map map cannot localize: no reference frame (panorama with pose and place); build the map from "
        "data with reference frames\n"
    )
    assert (done.code, done.err) == (2, message)


def test_rooms_without_doors_are_built_and_said_to_be_apart(rooms):
    done = run("map", "build", "rooms", "-o", "map", "--method", "reader")
    assert (
        "the region room-1 cannot be reached from the other regions: no door of the region is wide enough for the robot"
        in done.out
    )
    done = run("map", "route", "map", "room-0", "room-1")
    assert (done.code, done.err) == (2, "error: no route from room-0 to room-1: the map has no path between them\n")


def test_floors_above_each_other_are_said_to_be_apart(rooms):
    done = run("map", "build", "storeys", "-o", "map", "--method", "reader")
    assert done.code == 0
    assert (
        "  the 2 floors at z = 0.00, 3.00 m are not connected: add stairs or lifts with `salframe map connect`"
        in done.out.splitlines()
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["build", "maskless", "-o", "new", "--method", "reader", "--central-nodes"],
            "the data have neither floor masks nor range images to derive floors from",
        ),
        (
            ["build", "doored", "-o", "new", "--method", "reader", "--central-nodes", "--no-topology"],
            "received --central-nodes and --no-topology",
        ),
        (
            ["build", "doored", "-o", "new", "--method", "reader", "--floor-map", "robot.yaml", "--no-topology"],
            "received --floor-map and --no-topology",
        ),
        (["build", "maskless", "-o", "new", "--method", "reader", "--floor-map", "robot.yaml"], "robot.yaml"),
        (
            ["build", "crooked", "-o", "new", "--method", "reader"],
            "the region mask of the floor with z_m = 0.0 is 4 x 3 pixels, expected 100 x 16",
        ),
        (
            ["build", "doored", "-o", ".", "--method", "reader"],
            ". contains files that are not a map, expected a new or empty folder",
        ),
        (["build", "doored", "-o", "new", "--method", "raeder"], "unknown method 'raeder', did you mean 'reader'?"),
        (["route", "map", "room-0", "rom-1"], "unknown node or place 'rom-1', did you mean 'room-1'?"),
        (
            ["route", "map", "room-0", "room-1", "--planner", "dijkstr"],
            "unknown planner 'dijkstr', did you mean 'dijkstra'?",
        ),
        (
            ["route", "absent", "room-0", "room-1"],
            "absent contains no map: build one with salframe build DATA -o absent",
        ),
        (["show", "absent"], "absent contains no map"),
        (["add", "map", "dored"], "unknown dataset 'dored', did you mean 'doored'?"),
        (["add", "new", "doored"], "new contains no map: build one with salframe build DATA -o new"),
        (
            ["add", "map", "doored", "--set", "offset=1"],
            "received the setting 'offset', expected data.KEY or engine.KEY, where KEY",
        ),
        (["remove", "map", "rom-1"], "unknown place 'rom-1', did you mean 'room-1'?"),
        (["remove", "new", "room-1"], "new contains no map: build one with salframe build DATA -o new"),
        (
            ["merge", "map", "map"],
            "the maps map and map both contain the places room-0, room-1, room-2, room-3, room-4, expected different",
        ),
        (["merge", "map", "new"], "new contains no map: build one with salframe build DATA -o new"),
        (
            ["export", "map", "map.dot"],
            "received the file map.dot, expected one that ends in .json, .geojson, .yaml, .svg, .graphml or .parquet",
        ),
        (["query", "map", "query-1-9", "--data", "doored"], "unknown frame 'query-1-9'"),
    ],
)
def test_what_a_user_gets_wrong_is_one_line(built, tmp_path, arguments, message):
    done = run("map", *arguments)
    assert done.code == 2
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert message in done.err
    assert not (tmp_path / "new").exists()


def test_floor_masks_have_priority_over_a_map_file(built, tmp_path):
    assert run("map", "export", "map", "robot.yaml").code == 0
    done = run("map", "build", "doored", "-o", "new", "--method", "reader", "--floor-map", "robot.yaml")
    assert (done.code, done.err) == (
        0,
        "warning: the floor map robot.yaml is not used, because the data have floor masks\n",
    )
    assert open_topology(tmp_path / "new") == open_topology(tmp_path / "map")


def test_an_exported_map_file_gives_the_free_space_of_data_without_masks(built, tmp_path):
    assert run("map", "export", "map", "robot.yaml").code == 0
    done = run("map", "build", "maskless", "-o", "new", "--method", "reader", "--floor-map", "robot.yaml")
    assert (done.code, done.err) == (0, "")
    topology = open_topology(tmp_path / "new")
    assert topology.sources.free_space is PartSource.MAP_FILE
    assert run("map", "route", "new", "room-0", "room-4").code == 0


def test_a_failed_build_leaves_the_old_map(built, tmp_path):
    def files():
        return {path: path.read_bytes() for path in (tmp_path / "map").rglob("*") if path.is_file()}

    before = files()
    assert (
        run(
            "map",
            "build",
            "doored",
            "-o",
            "map",
            "--method",
            "reader",
            "--set",
            "data.broken=[map-1,map-2,map-3]",
            "--set",
            "data.rooms=6",
        ).code
        == 2
    )
    assert files() == before
    assert sorted(path.name for path in tmp_path.iterdir() if "map" in path.name) == ["map"]


def test_a_picture_replaces_pictures_alone(built, tmp_path):
    (tmp_path / "thesis.png").write_text("years")
    done = run("map", "show", "map", "-o", "thesis.png")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "thesis.png exists and is not a PNG" in done.err
    assert (tmp_path / "thesis.png").read_text() == "years"
    for _ in range(2):
        assert run("map", "show", "map", "-o", "new.png").code == 0


def test_stairs_connect_floors_and_routes_take_them(rooms, tmp_path):
    assert run("map", "build", "storeys", "-o", "map", "--method", "reader").code == 0
    nodes = open_topology(tmp_path / "map").nodes
    lower, upper = (choose(nodes, key=lambda node: node.xyz_m[2]).id for choose in (min, max))
    assert run("map", "route", "map", lower, upper).code == 2
    done = run("map", "connect", "map", lower, upper, "--kind", "lift", "--length", "15")
    assert (done.code, done.out.splitlines()[0]) == (0, "map: 1 connections between 2 floors")
    route = run("map", "route", "map", lower, upper, "--json").json
    assert route["length_m"] == 15.0
    assert [(step["kind"], step["floor"], step["say"]) for step in route["steps"]] == [
        ("lift", 2, f"take the lift to floor 2, to {upper}")
    ]
    assert run("map", "show", "map").code == 0
    assert run("map", "export", "map", "map.geojson").code == 0
    done = run("map", "connect", "map", lower)
    assert (done.code, done.err) == (
        2,
        "error: received only a part of FROM, TO and --length, expected either FROM, TO and --length, "
        "or --file FILE.csv\n",
    )
    done = run("map", "connect", "map", lower, upper, "--kind", "ladder", "--length", "2")
    assert done.code == 2
    assert "stairs" in done.err
