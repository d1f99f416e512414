"""The library as its users meet it: one import, one call, types, and reprs that fit a screen."""

import subprocess
import sys

import numpy as np
import pytest

import polymap_ros
from polymap_ros import (
    Candidate,
    Edge,
    Estimate,
    ParameterError,
    Parameters,
    Ping,
    PolygonMapper,
    PolymapError,
    Pose,
    RecordedPulse,
    UsageError,
    load_parameters,
    load_scene,
    map_polygon,
    simulate,
)

CODE = '''
from polymap_ros import Estimate, Parameters, Ping, PolygonMapper, map_polygon
estimate = map_polygon([[0.0, 0.0, 0.0]], [[0.0, 1.0]], period_s=1e-6, parameters=Parameters.of(solver={'seed': 2}))
reveal_type(estimate)
reveal_type(PolygonMapper(Parameters()).solve().polygon)
'''


def test_all_that_is_promised_is_there():
    for name in polymap_ros.__all__:
        assert getattr(polymap_ros, name).__name__ == name
        assert name in dir(polymap_ros)
    with pytest.raises(AttributeError, match="no attribute 'PolygonMaper'"):
        _ = polymap_ros.PolygonMaper


@pytest.mark.slow
def test_a_type_checker_sees_the_types(tmp_path):
    pytest.importorskip('mypy')
    (tmp_path / 'user.py').write_text(CODE)
    run = subprocess.run([sys.executable, '-m', 'mypy', '--strict', '--follow-imports=silent', 'user.py'], cwd=tmp_path,
                         capture_output=True, text=True, timeout=300)
    assert 'Revealed type is "polymap_ros.solvers.estimate.Estimate"' in run.stdout
    assert 'Revealed type is "polymap_ros.solvers.estimate.Candidate | None"' in run.stdout
    assert 'error' not in run.stdout


def test_parameters_in_one_line():
    parameters = Parameters.of(medium={'model': 'constant', 'speed_m_s': 340}, solver={'seed': 2})
    assert (parameters.medium.model, parameters.medium.speed_m_s, parameters.solver.seed) == ('constant', 340.0, 2)
    assert repr(parameters) == "Parameters.of(medium={'model': 'constant', 'speed_m_s': 340.0}, solver={'seed': 2})"
    assert repr(Parameters()) == 'Parameters.of()'
    of_numpy = {'medium': {'model': np.str_('constant'), 'speed_m_s': np.float64(340)}, 'solver.seed': np.int64(2)}
    assert Parameters.of(of_numpy) == parameters
    assert Parameters.of(front_end={'remove_dc': np.bool_(True)}).front_end.remove_dc is True
    for groups, says in (({'medium': {'modle': 'constant'}}, r'medium\.modle: unknown; did you mean medium\.model'),
                         ({'medium': 'constant'}, 'medium: .* is no mapping'),
                         ({'solver': {'seed': 1.5}}, r'solver\.seed')):
        with pytest.raises(ParameterError, match=says):
            Parameters.of(**groups)


def test_lists_and_counts_are_samples():
    assert Ping(0, [0, 5, -3], 1e-6).samples.dtype == np.float64
    assert Ping(0, np.array([0, 5], np.int16), 1e-6).samples.dtype == np.float32
    kept = np.zeros(3, np.float32)
    assert Ping(0, kept, 1e-6).samples is kept


NOISE = np.random.default_rng(1).normal(size=(1, 2048))


@pytest.mark.parametrize(('poses', 'samples', 'more', 'says'), [
    ([[0, 0]], [[0.0, 1.0]], {}, r'poses: found shape \(1, 2\)'),
    ([[0, 0, 0]], [[0.0, 1.0]] * 2, {}, '1 poses, 2 rows of samples and 1 stamps'),
    ([[0, 0, 0]] * 2, [[0.0, 1.0]] * 2, {'stamps_s': [1.0, 1.0]}, 'stamps_s: found times that do not rise'),
    ([[0, 0, 0]], [[0.0, 1.0]], {'stamps_s': [1e12]}, r'stamps_s: found 1e\+12 s'),
    ([[0, 0, 0]], [[0.0, 1.0]], {'t0_s': float('nan')}, 't0_s: found nan'),
    ([[0, 0, 0]], [[0.0, 1.0]], {'period_s': '1e-6'}, "period_s: found '1e-6'"),
    ([[0, 0, 0]], [[0.0, 1.0]], {'parameters': 3}, 'parameters: found 3'),
    ([[0, 0, 0]], [[0.0, 1.0]], {'recorded_pulse': [6, 5, 4, 5]}, 'recorded_pulse: its samples lie about 5 with'),
    ([[0, 0, 0]], [[0.0, 1.0]], {'recorded_pulse': [1, 1]}, 'recorded_pulse: all of its 2 samples are 1'),
    ([[0, 0, 0], [0, 0]], [[0.0, 1.0]], {}, 'poses: found'), ([['a', 'b', 'c']], [[0.0, 1.0]], {}, 'poses: found'),
    ([], [], {}, 'poses: found'), (np.zeros((0, 3)), np.zeros((0, 9)), {}, 'poses: found'),
    ([[0, 0, 0]], None, {}, 'samples: found None'), ([[0, 0, 0]], 3, {}, 'samples: found 3'),
    ([[0, 0, 0]], ['abc'], {}, "samples: found 'abc'"), ([[0, 0, 0]], [[[0, 1], [2]]], {}, 'rows of several lengths'),
    ([[0, 0, 0]], [[1j, 0]], {}, 'bad_shape: the samples are of type complex128; allowed: real numbers'),
    ([[0, 0, 10], [0, 0, 20]], [[0.0, 1.0]] * 2, {}, 'changes by 10 from row 0 to the next; headings are in radians'),
    ([[2e9, 0, 0]], [[0.0, 1.0]], {}, r'poses: found 2e\+09 m'),
    ([[0, 0, 0]], np.array([[0.5, 1.0]], object), {}, 'of type object; allowed: numbers'),
    ([[0, 0, 0]], np.ma.masked_array(NOISE, NOISE > 3), {}, 'bad_samples: [0-9]+ of 2048 samples are not finite'),
    ([[0, 0, 0]], [[0.0, 1.0]], {}, 'no ping can be used, most as too_short: 2 samples end'),
])
def test_what_cannot_be_mapped_is_said(poses, samples, more, says):
    with pytest.raises(UsageError, match=says):
        map_polygon(poses, samples, **{'period_s': 1e-6, **more})


class Table:
    """As of pandas: it gives its columns one by one."""

    def __init__(self, rows):
        self.rows = rows

    def __iter__(self):
        return iter(range(self.rows.shape[1]))

    def to_numpy(self):
        return self.rows


def test_tables_and_long_doubles_are_arrays():
    poses, samples = np.zeros((3, 3)), np.random.default_rng(2).normal(size=(3, 2048))
    plain, table, long = (map_polygon(poses, given, period_s=1e-6).cautions
                          for given in (samples, Table(samples), samples.astype(np.longdouble)))
    assert plain == table == long


def test_groups_are_parameters():
    with pytest.raises(ParameterError, match=r"medium: \{'model': 'constant'\} is no group .*Parameters\.of\(medium="):
        Parameters(medium={'model': 'constant'})


def test_first_mistakes_are_told_by_name(tmp_path, monkeypatch):
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'p.yaml').write_text('/**: {ros__parameters: {solver: {seed: 7}}}\n')
    assert load_parameters('~/p.yaml').solver.seed == load_parameters(tmp_path / 'p.yaml').solver.seed == 7
    with pytest.raises(polymap_ros.SceneError, match='nope: no scene file'):
        load_scene(tmp_path / 'nope')
    mapper = PolygonMapper(Parameters())
    assert mapper.add_pose(0, (0.0, 0.0, 0.0))
    for wrong, says in ((lambda: load_parameters(3), 'parameter file: found 3'), (lambda: simulate(3), 'found 3'),
                        (lambda: mapper.add_pose(1, (0, 0)), r'pose: found \(0, 0\)'),
                        (lambda: mapper.add_ping(np.zeros(3)), 'ping: found ndarray'),
                        (lambda: Ping(0, [1, 2], '1e-6'), "period_s: found '1e-6'")):
        with pytest.raises(PolymapError, match=says):
            wrong()


def test_a_recorded_pulse_is_enough_by_itself():
    burst = np.sin(0.2 * np.pi * np.arange(20)) * np.hanning(20)
    mapper = PolygonMapper(Parameters(), burst.tolist())
    assert mapper.parameters.pulse.kind == 'file'
    again = PolygonMapper.from_state(Parameters(), mapper.state(), burst)
    assert again.parameters == mapper.parameters
    noise = np.random.default_rng(1).normal(size=(1, 1200))
    with pytest.raises(UsageError, match=r'pulse\.path is sampled at 500000 Hz, the echoes at 1e\+06 Hz'):
        map_polygon([[0, 0, 0]], noise, period_s=1e-6, recorded_pulse=RecordedPulse(burst, 2e-6))


def test_an_answer_without_a_polygon_and_reprs_that_fit_a_screen():
    noise = np.random.default_rng(1).normal(size=(2, 1200))
    estimate = map_polygon([[0, 0, 0], [0.1, 0.1, 0]], noise.tolist(), period_s=1e-6, stamps_s=[0.0, 60.0])
    assert isinstance(estimate, Estimate)
    assert (estimate.polygon, estimate.status) == (None, 'open')
    assert repr(estimate) == 'Estimate(open by evidence, polygon=None, cautions: too_few_pings)'
    mapper = PolygonMapper(Parameters())
    mapper.add_pose(0, Pose(0.0, 0.0))
    mapper.add_ping(ping := Ping(0, noise[0], 1e-6))
    assert repr(ping) == 'Ping(stamp_ns=0, samples: 1200 of 1e-06 s from 0 s)'
    assert repr(mapper) == 'PolygonMapper(1 pings, 1 used, estimate=None)'
    assert len(repr(mapper.soundings[0])) < 120
    assert repr(RecordedPulse([0, 1, 0], 1e-6)) == 'RecordedPulse(3 samples of 1e-06 s)'
    assert repr(load_scene('triangle')) == "Scene('triangle': 3 edges, 60 pings of 2048 samples at 1e+06 Hz, seed 10)"


def test_reprs_tell_corners_of_utm_apart():
    edge = Edge(5.4e6, 0.123456789, 0.99, 0.00123456, 1e-3, 7)
    assert repr(edge) == (
        'Edge(r=5400000.00000, theta=0.123457, likelihood=0.99, r_std=0.00123, theta_std=0.001, pings=7)')
    corners = np.array([[0, 0], [0.5, 0], [0, 0.4]]) + [500_000, 5_400_000]
    assert repr(Candidate(corners, (edge,) * 3)) == (
        'Candidate(3 edges: (500000.0000, 5400000.0000), (500000.5000, 5400000.0000), (500000.0000, 5400000.4000))')


@pytest.mark.parametrize(('given', 'text'), [
    (3, '3: must be a mapping such as'), ({'medum': {}}, 'medum: unknown; did you mean medium'),
    ({'medium': 3}, '3 is no mapping')])
def test_parameters_of_what_are_none_are_refused_by_name(given, text):
    with pytest.raises((UsageError, ParameterError), match=text):
        Parameters.of(given)
