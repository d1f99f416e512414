"""A path in the TUM format: read back by scipy's rotations and digit by digit, and by ourselves."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polymap_ros.errors import RecordingError
from polymap_ros.recordings.truth import read_true_path
from polymap_ros.results.tum import tum

STAMPS = np.array([1_700_000_000_000_000_001, 1_700_000_000_500_000_000, 1_700_000_001_000_000_000])
POSES = np.array([(1.0, -2.5, 0.3), (1e-9, 123.456789012345, -3.0), (0.0, 0.0, 3.1)])


def test_every_digit_of_stamps_and_places_is_there():
    rows = [line.split() for line in tum(STAMPS, POSES).decode().splitlines()]
    assert [row[0] for row in rows] == ['1700000000.000000001', '1700000000.500000000', '1700000001.000000000']
    np.testing.assert_array_equal([[float(word) for word in row[1:3]] for row in rows], POSES[:, :2])
    turns = Rotation.from_quat([[float(word) for word in row[4:]] for row in rows])
    np.testing.assert_allclose(turns.as_euler('zyx')[:, 0], POSES[:, 2], atol=1e-12)


def test_a_true_path_beside_a_recording_is_read(tmp_path):
    (tmp_path / 'truth.tum').write_bytes(b'# a comment\n' + tum(STAMPS, POSES))
    stamps, poses = read_true_path(tmp_path)
    np.testing.assert_array_equal(stamps, STAMPS)
    np.testing.assert_allclose(poses, POSES, atol=1e-12)


@pytest.mark.parametrize('text', ['1.0 2 3', 'a b c d e f g h', '2.0 0 0 0 0 0 0 1\n1.0 0 0 0 0 0 0 1',
                                  '1.0 nan 0 0 0 0 0 1'])
def test_what_is_no_path_is_named(tmp_path, text):
    (tmp_path / 'truth.tum').write_text(text)
    with pytest.raises(RecordingError, match=r'truth\.tum'):
        read_true_path(tmp_path)


def test_without_one_there_is_none(tmp_path):
    assert read_true_path(tmp_path) is None
