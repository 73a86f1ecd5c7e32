"""Motion files: poses of views as motions to the last view, and one line for each fault."""

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas.motion_file import read_motion

HEADER = "t_s,x_m,y_m,z_m,yaw_deg\n"


def test_motions_map_to_the_last_view(tmp_path):
    """A robot drives 2 m along +y of the odometry frame, then turns to the right: what was 1 m ahead is behind."""
    file = tmp_path / "motion.csv"
    file.write_text(HEADER + "0, 5, 1, 0.2, 90\n1.5, 5, 3, 0.2, -90\n")
    (first, last), up = read_motion(file, 2)
    assert up is None
    np.testing.assert_allclose(first @ [1, 0, 0, 1], [1, 0, 0, 1], atol=1e-12)  # 1 m ahead of the first view
    np.testing.assert_allclose(first @ [0, 0, 0.5, 1], [2, 0, 0.5, 1], atol=1e-12)
    np.testing.assert_array_equal(last, np.eye(4))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s,x_m,y_m,yaw_deg\n0,0,0,0\n1,0,0,0\n", "has no column z_m, expected the columns t_s,x_m,y_m,z_m,yaw_deg"),
        (HEADER + "0,0,0,0,0\n", "has 1 rows for 2 views, expected one row for each view"),
        (HEADER + "0,0,0,0,0\n1,0,0,0,0\n2,0,0,0,0\n", "has 3 rows for 2 views"),
        (HEADER + "1,0,0,0,0\n0.5,0,0,0,0\n", r"t_s goes from 1 to 0\.5 in row 2, expected increasing times"),
        (HEADER + "0,0,0,0,0\n1,0,nan,0,0\n", "y_m is 'nan' in row 2, expected a finite number"),
        (HEADER + "0,0,0,0,0\n1,0,0,0\n", "yaw_deg is '' in row 2, expected a finite number"),
        (HEADER + "0,0,0,0,0\n1,0,0,0,left\n", "yaw_deg is 'left' in row 2"),
        ("", "has no column t_s"),
    ],
)
def test_a_wrong_motion_file_is_refused(tmp_path, text, message):
    file = tmp_path / "motion.csv"
    file.write_text(text)
    with pytest.raises(DataError, match=message):
        read_motion(file, 2)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DataError, match=r"absent\.csv"):
        read_motion(tmp_path / "absent.csv", 2)


def test_roll_and_pitch_tilt_the_views(tmp_path):
    """A camera that looks 30 degrees down, then leans 90 degrees to its right side after a turn to the left."""
    file = tmp_path / "motion.csv"
    file.write_text("t_s,x_m,y_m,z_m,yaw_deg,roll_deg,pitch_deg\n0,0,0,1,0,0,30\n1,2,0,1,90,90,0\n")
    (first, _), up = read_motion(file, 2)
    half, root = 0.5, np.sqrt(0.75)
    np.testing.assert_allclose(up, [[-half, 0, root], [0, 1, 0]], atol=1e-12)  # right side down: left is up
    # 1 m ahead of the first view is 0.87 m ahead and 0.5 m down in the world. The last view looks along +y of the
    # world, its left side up, and its head to +x.
    expected = [0, -half, root - 2, 1]
    np.testing.assert_allclose(first @ [1, 0, 0, 1], expected, atol=1e-12)


def test_roll_without_pitch_is_refused(tmp_path):
    file = tmp_path / "motion.csv"
    file.write_text("t_s,x_m,y_m,z_m,yaw_deg,roll_deg\n0,0,0,1,0,0\n1,2,0,1,90,90\n")
    with pytest.raises(DataError, match="only one of the columns roll_deg and pitch_deg"):
        read_motion(file, 2)
