"""Arrays come back as they were; a file that is no state is refused without running what is in it."""

import io

import numpy as np
import pytest

from polymap_ros.errors import StateError
from polymap_ros.mapping.beamforming import BeamformingMap
from polymap_ros.mapping.pose import Pose
from polymap_ros.parameters import GridParameters
from polymap_ros.results.arrays import beam_map_npz, npz, read_state, state_npz

STATE = {
    'stamps_ns': np.array([1, 2], dtype=np.int64), 'frame_id': np.array('odom'), 'map': np.eye(3, dtype=np.float32),
}


def test_a_state_comes_back_and_its_bytes_repeat(tmp_path):
    (tmp_path / 'state.npz').write_bytes(state_npz(STATE))
    found = read_state(tmp_path / 'state.npz')
    assert found.keys() == STATE.keys()
    for name, values in STATE.items():
        assert found[name].dtype == values.dtype
        np.testing.assert_array_equal(found[name], values)
    assert state_npz(found) == state_npz(STATE)


def test_what_would_be_pickled_is_not_written():
    with pytest.raises(TypeError, match='thing: would need pickle'):
        npz({'thing': np.array([{}], dtype=object)})


def test_a_missing_state_says_so(tmp_path):
    with pytest.raises(StateError, match=r'none\.npz: cannot be read: No such file'):
        read_state(tmp_path / 'none.npz')


def one_array():
    buffer = io.BytesIO()
    np.save(buffer, np.eye(2))
    return buffer.getvalue()


def pickled():
    buffer = io.BytesIO()
    np.savez(buffer, format=np.array('polymap-state/1'), trap=np.array([Exception], dtype=object))
    return buffer.getvalue()


@pytest.mark.parametrize('content', [
    b'', b'hello', bytes(300), pickled(), one_array(), npz({}), npz({'a': np.eye(2)}),
    npz({'format': np.array('polymap-state/2')}), state_npz(STATE)[:-30], state_npz(STATE)[:100]])
def test_a_file_that_is_no_state(tmp_path, content):
    (tmp_path / 'state.npz').write_bytes(content)
    with pytest.raises(StateError, match=r'state\.npz: (is no saved state|has format)') as caught:
        read_state(tmp_path / 'state.npz')
    assert 'pickle' not in str(caught.value)


def test_a_flipped_bit_is_noticed(tmp_path):
    content = bytearray(state_npz(STATE))
    position = content.index(STATE['map'].tobytes())
    content[position + 5] ^= 4
    (tmp_path / 'state.npz').write_bytes(content)
    with pytest.raises(StateError, match='is no saved state'):
        read_state(tmp_path / 'state.npz')


def test_the_beam_map_has_its_axes_and_frame():
    beam_map = BeamformingMap(GridParameters(range_max_m=1.0, range_step_m=0.25, angle_step_deg=90.0))
    beam_map.add(0.0, 0.0, np.array([0, 0, 1, 0, 0], dtype=np.float32))
    with np.load(io.BytesIO(beam_map_npz(beam_map, Pose(1.0, 2.0, 0.5)))) as found:
        assert set(found.files) == {'map', 'r_m', 'theta_rad', 'start_pose'}
        np.testing.assert_array_equal(found['map'], np.tile([0, 0, 1, 0, 0], (4, 1)))
        np.testing.assert_allclose(found['r_m'], [0, 0.25, 0.5, 0.75, 1])
        np.testing.assert_allclose(found['theta_rad'], np.arange(4) * np.pi / 2)
        np.testing.assert_array_equal(found['start_pose'], [1.0, 2.0, 0.5])
