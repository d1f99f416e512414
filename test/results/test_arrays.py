"""Arrays come back as they were; a file that is no state is refused without running what is in it."""

import io
import tracemalloc

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.errors import StateError
from polymap_ros.geometry.pose import Pose
from polymap_ros.map_parameters import GridParameters
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.maps.beamforming import BeamformingMap
from polymap_ros.parameters import Parameters
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


@pytest.fixture
def small():
    """A mapper with two pings used and one waiting, and the parameters it was made with."""
    parameters = Parameters().replaced({
        'medium.model': 'constant', 'medium.speed_m_s': 1500.0, 'grid.range_max_m': 0.1, 'grid.angle_step_deg': 30.0,
        'echo.blanking_m': 0.0})
    mapper = PolygonMapper(parameters)
    for k in range(3):
        mapper.add_pose(k * 10**8, Pose(0.01 * k, 0.0))
        mapper.add_ping(Ping(k * 10**8 + k // 2, np.random.default_rng(k).normal(size=256), 1e-6))
    assert (mapper.counts.used, mapper.counts.waiting) == (2, 1)
    return mapper, parameters


def test_a_flipped_bit_is_noticed_or_harmless(small, tmp_path):
    """Every member has its CRC-32; beyond that there are only the archive's own records, such as dates."""
    mapper, parameters = small
    whole, state = np.frombuffer(state_npz(mapper.state()), np.uint8), mapper.state()
    rng, refused = np.random.default_rng(1), 0
    path = tmp_path / 'state.npz'
    for case in range(400):
        content = whole.copy()
        # Half of them in the archive's directory, which is at the end.
        position = whole.size - 1 - rng.integers(4000) if case % 2 else rng.integers(whole.size)
        content[position] ^= np.uint8(1 << rng.integers(8))
        path.write_bytes(content.tobytes())
        try:
            found = read_state(path)
            PolygonMapper.from_state(parameters, found)
        except StateError:
            refused += 1
            continue
        assert found.keys() == state.keys()
        for name, array in state.items():
            np.testing.assert_array_equal(found[name], array)
    assert refused > 200, 'most of what is flipped is content'


@pytest.mark.parametrize('share', [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_state_that_was_cut_off(small, tmp_path, share):
    whole = state_npz(small[0].state())
    (tmp_path / 'state.npz').write_bytes(whole[:int(share * len(whole))])
    with pytest.raises(StateError, match=r'state\.npz: is no saved state, or a damaged one'):
        read_state(tmp_path / 'state.npz')


def test_a_compressed_state_is_refused_before_it_becomes_large(small, tmp_path):
    np.savez_compressed(tmp_path / 'state.npz', format='polymap-state/1', bomb=np.zeros(2**24))
    tracemalloc.start()
    with pytest.raises(StateError):
        read_state(tmp_path / 'state.npz')
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2**24


def test_a_state_of_another_version_says_which_is_needed(small):
    mapper, parameters = small
    with pytest.raises(StateError, match='the state has version 99; allowed: 3'):
        PolygonMapper.from_state(parameters, {**mapper.state(), 'version': np.array(99)})


@pytest.mark.parametrize('code', [0x4E4E4E4E, 0x110000, 0xD800])
def test_a_state_with_text_that_is_none(small, tmp_path, code):
    state = small[0].state()
    state['parameters'] = np.frombuffer(np.full(4, code, np.uint32).tobytes(), '<U4').reshape(1, 1)
    (tmp_path / 'state.npz').write_bytes(state_npz(state))
    with pytest.raises(StateError, match='is no saved state, or a damaged one'):
        read_state(tmp_path / 'state.npz')


def test_a_ping_that_waits_in_a_state_is_looked_at_like_any_other(small):
    mapper, parameters = small
    state = mapper.state()
    state['queue.waiting_times'] = state['queue.waiting_times'] * (1e300, 1.0, 1.0, 1.0)
    with pytest.raises(StateError, match='the state is damaged: a sample period of 1e'):
        PolygonMapper.from_state(parameters, state)
