"""Parameters: every rule of names, types, values and files."""

import dataclasses
import math

import pytest

from polymap_ros.echo_parameters import EchoParameters
from polymap_ros.errors import ParameterError, UsageError
from polymap_ros.map_parameters import FreeAreaParameters, GridParameters
from polymap_ros.parameter_file import load_parameters, parse_override
from polymap_ros.parameters import (
    FrontEndParameters,
    MapParameters,
    MediumParameters,
    Parameters,
    PulseParameters,
    SensorParameters,
    SolverParameters,
    specifications,
)

# The published names and defaults: users' files depend on them.
PUBLISHED = {
    'medium.model': 'lamb_a0', 'medium.thickness_m': 0.006, 'medium.longitudinal_speed_m_s': 6149.0,
    'medium.shear_speed_m_s': 3097.0, 'medium.speed_m_s': 343.0, 'medium.spreading_exponent': -1.0,
    'pulse.kind': 'tone_burst', 'pulse.frequency_hz': 100000.0, 'pulse.cycles': 2.0, 'pulse.window': 'hann',
    'pulse.bandwidth_hz': 0.0, 'pulse.duration_s': 0.0, 'pulse.path': '',
    'echo.type': 'sensor_msgs/msg/LaserScan', 'echo.kind': 'rf', 'echo.t0_s': 0.0, 'echo.sample_period_s': 0.0,
    'echo.blanking_m': 0.02, 'echo.allow_unstamped': False,
    'sensor.x_m': 0.0, 'sensor.y_m': 0.0,
    'grid.range_max_m': 3.0, 'grid.range_step_m': 0.005, 'grid.angle_step_deg': 1.0, 'grid.angle_min_deg': 0.0,
    'grid.angle_max_deg': 360.0,
    'solver.method': 'evidence',
    'solver.max_edges': 10, 'solver.period_s': 1.0, 'solver.seed': 1, 'solver.iterations': 300,
    'solver.iou_weight': 3.0, 'solver.edge_filter_epsilon': 0.01, 'solver.neighbourhood_m': 0.054,
    'solver.neighbourhood_deg': 48.0,
    'map.resolution_m': 0.0, 'map.margin_m': 0.1,
    'output.dir': 'polymap', 'output.autosave_s': 0.0, 'output.load_path': '',
    'topics.odom': 'odom', 'topics.echo': 'echo',
}


@pytest.fixture
def write(tmp_path):
    def write_file(text):
        path = tmp_path / 'parameters.yaml'
        path.write_text(text, encoding='utf-8')
        return path
    return write_file


def test_published_names_and_defaults_hold():
    values = Parameters().flat()
    assert {name: values.get(name) for name in PUBLISHED} == PUBLISHED
    assert {name: type(values[name]) for name in PUBLISHED} == {name: type(v) for name, v in PUBLISHED.items()}


def test_every_parameter_has_a_text_and_a_valid_default():
    assert len(specifications()) == len(Parameters().flat())
    for spec in specifications():
        assert spec.text
        assert spec.check(spec.default) == spec.default
        assert type(spec.default) is spec.type
        assert spec.name.endswith('_' + spec.unit.lower().replace('/', '_')) or (
            spec.unit in ('', 'cycles', 'm per root m', 'deg per root m')), spec.name


@pytest.mark.parametrize('spec', specifications(), ids=lambda spec: spec.name)
def test_every_parameter_refuses_the_wrong_type_and_what_is_out_of_range(spec):
    wrong = [None, [1.0], {'a': 1}, 'text' if spec.type is not str else 1.0]
    wrong += [True] if spec.type is not bool else [0, 1]
    wrong += [1.5, 1.0] if spec.type is int else []
    wrong += [math.nan, math.inf, -math.inf] if spec.type is float else []
    wrong += ['no such choice'] if spec.choices else []
    wrong += [type(spec.default)(spec.minimum - 1)] if spec.minimum is not None else []
    wrong += [type(spec.default)(spec.above)] if spec.above is not None else []
    wrong += [type(spec.default)(spec.maximum + 1)] if spec.maximum is not None else []
    for value in wrong:
        with pytest.raises(ParameterError) as refused:
            Parameters().replaced({spec.name: value})
        assert refused.value.name == spec.name
        assert spec.name in str(refused.value)
        assert spec.allowed() in str(refused.value)


def test_an_integer_is_taken_for_a_double():
    parameters = Parameters().replaced({'grid.range_max_m': 5, 'pulse.cycles': 3})
    assert parameters.grid.range_max_m == 5.0
    assert type(parameters.grid.range_max_m) is float
    assert type(GridParameters(range_max_m=5).range_max_m) is float
    with pytest.raises(ParameterError, match='double'):
        Parameters().replaced({'grid.range_max_m': True})


@pytest.mark.parametrize(('name', 'hint'), [
    ('grid.range_stepm', 'grid.range_step_m'),
    ('solver.lambda', 'solver.method'),
    ('thickness_m', 'medium.thickness_m'),
    ('grid', 'grid.range_max_m'),
])
def test_an_unknown_name_is_refused_with_a_hint(name, hint):
    with pytest.raises(ParameterError, match='unknown') as refused:
        Parameters().replaced({name: 1.0})
    assert hint in str(refused.value)


@pytest.mark.parametrize('method', ['evidence', 'paper', 'rectangle'])
def test_every_method_is_known(method):
    assert SolverParameters(method=method).method == method


@pytest.mark.parametrize(('build', 'name'), [
    (lambda: MediumParameters(shear_speed_m_s=7000.0), 'medium.shear_speed_m_s'),
    (lambda: PulseParameters(kind='chirp', duration_s=1e-3), 'pulse.bandwidth_hz'),
    (lambda: PulseParameters(kind='chirp', bandwidth_hz=1e3), 'pulse.duration_s'),
    (lambda: PulseParameters(kind='chirp', bandwidth_hz=3e5, duration_s=1e-3), 'pulse.bandwidth_hz'),
    (lambda: EchoParameters(type='sensor_msgs/msg/Image'), 'echo.sample_period_s'),
    (lambda: EchoParameters(type='std_msgs/msg/Float32MultiArray', sample_period_s=1e-6), 'echo.allow_unstamped'),
    (lambda: SensorParameters(from_tf=True, x_m=0.1), 'sensor.x_m'),
    (lambda: SensorParameters(from_tf=True, y_m=-0.1), 'sensor.y_m'),
    (lambda: GridParameters(range_step_m=2.0), 'grid.range_step_m'),
    (lambda: GridParameters(angle_min_deg=90.0, angle_max_deg=90.0), 'grid.angle_max_deg'),
    (lambda: GridParameters(angle_min_deg=-10.0, angle_max_deg=360.0), 'grid.angle_max_deg'),
    (lambda: GridParameters(range_step_m=1e-6), 'grid.range_step_m'),
    (lambda: GridParameters(angle_step_deg=1e-3), 'grid.angle_step_deg'),
    (lambda: PulseParameters(kind='chirp', bandwidth_hz=1e3, duration_s=1.0), 'pulse.duration_s'),
    (lambda: PulseParameters(kind='chirp', bandwidth_hz=1e3, duration_s=1e-9), 'pulse.duration_s'),
    (lambda: FrontEndParameters(band_high_hz=1e-300), 'front_end.band_high_hz'),
    (lambda: FreeAreaParameters(false_alarm=1e-300), 'free_area.false_alarm'),
    (lambda: MapParameters(resolution_m=1e-300), 'map.resolution_m'),
    (lambda: Parameters().replaced({'medium.thickness_m': 1.0, 'pulse.frequency_hz': 1e6}), 'medium.thickness_m'),
    (lambda: Parameters().replaced({'free_area.model': 'grid', 'free_area.cell_m': 1e-300}), 'free_area.cell_m'),
    (lambda: Parameters().replaced({'output.dir': 'two\nlines'}), 'output.dir'),
    (lambda: Parameters().replaced({'output.dir': '\ud800'}), 'output.dir'),
    (lambda: Parameters().replaced({'sensor.x_m': 10**400}), 'sensor.x_m'),
    (lambda: Parameters().replaced({'medium.edge': 'free', 'medium.model': 'constant'}), 'medium.edge'),
    (lambda: Parameters().replaced({'slam.map_origin': 'first_ping'}), 'slam.map_origin'),
    (lambda: Parameters().replaced({'slam.map_origin': 'first_ping', 'slam.map_frame': 'map',
                                    'slam.mode': 'localization'}), 'slam.map_origin'),
    (lambda: Parameters().replaced({'slam.map_origin': 'first_ping', 'slam.map_frame': 'map',
                                    'odometry.plane': 'first_pose'}), 'slam.map_origin'),
])
def test_values_that_do_not_go_together_are_refused(build, name):
    with pytest.raises(ParameterError) as refused:
        build()
    assert refused.value.name == name


def test_values_that_go_together_only_are_taken_together():
    chirp = {'pulse.kind': 'chirp', 'pulse.bandwidth_hz': 2e4, 'pulse.duration_s': 1e-3}
    assert Parameters().replaced(chirp).pulse.bandwidth_hz == 2e4
    # A shear speed above aluminium's longitudinal one is fine with a faster medium, and without a plate.
    assert Parameters().replaced({'medium.shear_speed_m_s': 7e3, 'medium.longitudinal_speed_m_s': 12e3})
    assert MediumParameters(model='constant', shear_speed_m_s=7e3)


def test_parameters_are_immutable_and_by_name():
    parameters = Parameters()
    with pytest.raises(dataclasses.FrozenInstanceError):
        parameters.grid.range_max_m = 1.0
    assert parameters['grid.range_max_m'] == 3.0
    assert parameters.replaced({}) == parameters
    assert list(parameters.flat()) == [spec.name for spec in specifications()]


@pytest.mark.parametrize(('name', 'text'), [
    ('pulse.cycles', 'double in [0.1, 1000] cycles'), ('solver.max_edges', 'integer in [3, 64]'),
    ('medium.model', 'lamb_a0 | constant'), ('echo.allow_unstamped', 'bool'), ('topics.odom', 'string'),
    ('echo.t0_s', 'double in [-100, 100] s'), ('medium.spreading_exponent', 'double in (-inf, 10]'),
])
def test_what_is_allowed_is_said_in_words(name, text):
    assert {spec.name: spec for spec in specifications()}[name].allowed() == text


@pytest.mark.parametrize(('text', 'value'), [
    ('solver.seed:=3', 3), ('grid.range_max_m:=2.5', 2.5), ('grid.range_max_m:=1.0e-2', 0.01),
    ('echo.allow_unstamped:=true', True), ('topics.odom:=/robot/odom', '/robot/odom'), ('pulse.path:=', ''),
])
def test_an_override_is_read_as_ros_reads_it(text, value):
    name, parsed = parse_override(text)
    assert name == text.partition(':=')[0]
    assert parsed == value
    assert type(parsed) is type(value)


@pytest.mark.parametrize('text', ['solver.seed', 'solver.seed=3', ':=3', '', 'solver.seed:=[1', 'solver.seed:={'])
def test_a_malformed_override_is_refused(text):
    with pytest.raises(ParameterError):
        parse_override(text)


def test_a_file_is_read_and_knows_its_folder(write):
    path = write('''
polymap_node:
  ros__parameters:
    pulse: {kind: file, path: pulse.npy}
    grid:
      range_max_m: 2
    solver.seed: 7
''')
    parameters = load_parameters(path)
    assert parameters.pulse.path == 'pulse.npy'
    assert parameters.grid.range_max_m == 2.0
    assert parameters.solver.seed == 7
    assert parameters.folder == path.parent.resolve()
    assert parameters.folder.is_absolute()


def test_the_last_key_counts(write):
    path = write('''
/**:
  ros__parameters: {solver: {seed: 1, max_edges: 7, iterations: 50}}
polymap_node:
  ros__parameters: {solver: {seed: 2, max_edges: 8}}
/robot1/*:
  ros__parameters: {solver: {seed: 3, whatever: 1}}
/robot2/*:
  ros__parameters: {solver: {seed: 4}}
/robot1/polymap_node:
  ros__parameters: {medium: {thickness_m: 0.004}}
/robot1/other_node:
  ros__parameters: {solver: {seed: 99}, whatever: 1}
''')
    told = []
    parameters = load_parameters(path, warn=told.append)
    solver = parameters.solver
    assert (solver.seed, solver.max_edges, solver.iterations, parameters.medium.thickness_m) == (3, 8, 50, 0.004)
    assert len(told) == 2
    assert '/robot2/* is for nodes elsewhere than /robot1/polymap_node, and left alone' in told[0]
    assert 'below /robot1/*: solver.whatever is no parameter' in told[1]


def test_a_value_in_the_place_of_a_group_below_all_nodes(write):
    told = []
    load_parameters(write('/**: {ros__parameters: {solver: paper}}'), warn=told.append)
    assert "solver is a group, and 'paper' stands in the place of its parameters; indent them, or write" in told[0]


def test_names_of_other_nodes_and_of_ros_are_left_alone(write):
    path = write('''
/**:
  ros__parameters: {use_sim_time: true, grid: {something_else: 1, range_max_m: 2.0}, robot: {name: a}}
polymap_node:
  ros__parameters:
    use_sim_time: true
    qos_overrides: {/odom: {subscription: {reliability: reliable}}}
''')
    assert load_parameters(path).grid.range_max_m == 2.0


@pytest.mark.parametrize(('text', 'said'), [
    ('polymap_node: {ros__parameters: {grid: {range_stepm: 1.0}}}', 'grid.range_stepm: unknown'),
    ('polymap_node: {ros__parameters: {grid: {range_step_m: wide}}}', 'grid.range_step_m'),
    ('/a/polymap_node: {ros__parameters: {solver: {method: magic}}}', 'paper | rectangle'),
    ('/**: {ros__parameters: {medium: {thickness_m: -1.0}}}', 'medium.thickness_m'),
    ('polymap_node: {ros__parameters: {grid: 3}}', 'grid is a group, and 3 stands in the place of its parameters; '),
    ('/**:\n  ros__parameters:\n    solver:\n    method: paper', 'solver is a group, and nothing stands below it'),
    ('polymap_node: {grid: {range_step_m: 1.0}}', 'polymap_node has no ros__parameters'),
    ('polymap_node: 3', 'polymap_node has no ros__parameters'),
    ('polymap_node: {ros__parameter: {solver: {seed: 1}}}',
     'polymap_node has no ros__parameters; did you mean ros__parameters by ros__parameter?'),
    ('other_node: {ros__parameters: {}}', 'only other_node'),
    ('other: {ros__parameters: {}}\npolymap_nod: {ros__parameters: {}}',
     'only other, polymap_nod; did you mean polymap_node by polymap_nod?'),
    ('robot: {polymap_nod: {ros__parameters: {}}}', 'only robot; did you mean polymap_node by polymap_nod?'),
    ('[1, 2]', 'not a ROS parameter file'),
    ('', 'not a ROS parameter file'),
    ('a: [1', 'is not YAML'),
])
def test_a_wrong_file_is_refused_in_one_line(write, text, said):
    with pytest.raises((ParameterError, UsageError)) as refused:
        load_parameters(write(text))
    assert said in str(refused.value)
    assert '\n' not in str(refused.value)


def test_an_empty_section_changes_nothing(write):
    assert load_parameters(write('polymap_node: {ros__parameters: {}}')) == Parameters()
    assert load_parameters(write('/**:\n  ros__parameters: {use_sim_time: false}')) == Parameters()


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(UsageError, match=r'missing\.yaml'):
        load_parameters(tmp_path / 'missing.yaml')
    with pytest.raises(UsageError, match=tmp_path.name):
        load_parameters(tmp_path)


@pytest.mark.parametrize('encoding', ['utf-16', 'latin-1'])
def test_a_file_that_is_not_utf_8_is_told_so(tmp_path, encoding):
    path = tmp_path / 'p.yaml'
    path.write_text('polymap_node: {ros__parameters: {output: {dir: Prüfung}}}', encoding=encoding)
    with pytest.raises(UsageError, match=r'p\.yaml: is not UTF-8; save it in that encoding$'):
        load_parameters(path)


def test_overrides_are_the_last_word_and_leave_the_rest_of_the_file(write):
    file = write('polymap_node: {ros__parameters: {solver: {seed: 6}, grid: {range_max_m: 1.0}}}')
    loaded = load_parameters(file, {'solver.seed': 5})
    assert loaded == Parameters().replaced({'solver.seed': 5, 'grid.range_max_m': 1.0})


def test_a_namespace_may_be_nested(tmp_path):
    path = tmp_path / 'nested.yaml'
    path.write_text('robot:\n  polymap_node:\n    ros__parameters:\n      solver: {seed: 7}\n')
    assert load_parameters(path).solver.seed == 7


def test_an_override_may_complete_what_the_file_begins(tmp_path):
    path = tmp_path / 'image.yaml'
    path.write_text('polymap_node:\n  ros__parameters:\n    echo: {type: sensor_msgs/msg/Image}\n')
    with pytest.raises(ParameterError, match=r'echo\.sample_period_s'):
        load_parameters(path)
    assert load_parameters(path, {'echo.sample_period_s': 1e-6}).echo.sample_period_s == 1e-6


@pytest.mark.parametrize('text', ['1e-6', '1E-6', '1.e-6', '+1e-6', '1.0e-6'])
def test_exponents_are_numbers_as_ros_reads_them(write, text):
    file = write(f'polymap_node: {{ros__parameters: {{echo: {{sample_period_s: {text}}}}}}}')
    assert load_parameters(file).echo.sample_period_s == 1e-6
    assert parse_override(f'echo.sample_period_s:={text}') == ('echo.sample_period_s', 1e-6)


def test_what_yaml_makes_of_off_is_off():
    """ROS reads ``-p slam.mode:=off`` as false; elsewhere false stays what it is."""
    assert Parameters.of({'slam.mode': False}).slam.mode == 'off'
    with pytest.raises(ParameterError, match='allowed: evidence'):
        Parameters.of({'solver.method': False})
