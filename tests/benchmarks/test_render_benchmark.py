"""Time of a panorama: the goal is 0.7 s in colour at 1024 x 512 on two cores. `make benchmark`."""

import pytest
from salframe_house.building import generate_building
from salframe_house.frames import choose_frames
from salframe_house.render import HouseRenderer

from salframe.panoramas.geometry import pose_2d

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=[("home", 12), ("office", 42)], ids=["home-12", "office-42"])
def views(request):
    """A renderer of a building by day and the poses of its first ten reference frames, the first picture painted."""
    building = generate_building(*request.param, 7)
    specs = choose_frames(building, building, 7, queries_per_room=1)[:10]
    poses = [pose_2d(spec.x_m, spec.y_m, spec.yaw_rad, spec.z_m) for spec in specs]
    renderer = HouseRenderer(building.scene(), "day")
    renderer.render(poses[0])
    return renderer, poses


@pytest.mark.parametrize("what", ["render", "geometry"])
def test_panorama(benchmark, views, what):
    renderer, poses = views
    waiting = iter(poses)
    benchmark.pedantic(getattr(renderer, what), setup=lambda: ((next(waiting),), {}), rounds=len(poses))
