"""Keys and scalars of a parameter file mean what they mean to ROS: each is given to a real node, and read by ours."""

import math

import pytest

pytest.importorskip('rclpy')

import rclpy

from polymap_ros.errors import UsageError
from polymap_ros.names import for_node
from polymap_ros.node.joining import init
from polymap_ros.parameter_file import load_parameters
from polymap_ros.plain_yaml import read_parameter_yaml

SCALARS = r'''
2026-11-29 2026-11-29T10:00:00 = << yes no on off y n Y N True TRUE tRUE YES oN
0x10 0X1f -0x10 +0x10 010 09 0o17 0b11 -0 00 0777777777777777777777777 --5 +-5 + .. 1__0 1_000 1_0.5
9223372036854775807 9223372036854775808 -9223372036854775808 -9223372036854775809 99999999999999999999
0x7fffffffffffffff 0xffffffffffffffffff 0x 0xg 0x1p3 0x1.8p1 0x.8 0x0p9 -0x1P-3 0x1p99999 0x1p-1074 0x1p-1080
1e3 1E3 -2E+3 .5 5. -7. +.5 1.e3 .e3 1e 1e+ 1.5e3x 1d3 1f 1:30 1:30.5 -0.0 0e5 -0e-999 1e400 -1e400 1e-400 1e-310
.inf -.inf +.inf .Inf .INF .iNF inf -inf Infinity .nan .NaN .NAN .Nan +.nan nan -nan NaN nan(1)
~ null Null NULL "5" 'yes' '~' \u0661 text
'''.split()  # noqa: SIM905, in rows of a kind
TAGGED = ('!!str 5', '!!int "5"', '!!int 5', '!!float 5', '!!bool yes', '!!bool "yes"', "!!null ''", '!!null ~',
          '!!timestamp 2026-11-29', 'a b', '1 2', '5 # five', '|-\n        5', '>-\n        yes', '|\n        5')


@pytest.fixture(scope='module')
def received(tmp_path_factory):
    """What a node takes each scalar for."""
    path = tmp_path_factory.mktemp('yaml') / 'table.yaml'
    path.write_text('table:\n  ros__parameters:\n' + ''.join(
        f'    p{k}: {text}\n' for k, text in enumerate((*SCALARS, *TAGGED))), encoding='utf-8')
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', '--params-file', str(path)])
    node = rclpy.create_node('table', context=context, automatically_declare_parameters_from_overrides=True)
    yield {text: node.get_parameter(f'p{k}').value for k, text in enumerate((*SCALARS, *TAGGED))}
    node.destroy_node()
    context.try_shutdown()


@pytest.mark.parametrize('text', [*SCALARS, *TAGGED])
def test_a_scalar_is_read_as_by_a_node(received, text):
    ours, theirs = read_parameter_yaml(f'p: {text}\n')['p'], received[text]
    assert type(ours) is type(theirs)
    assert ours == theirs or (math.isnan(ours) and math.isnan(theirs))


KEYS = ('/**', '/*', '**', '*', 'polymap_node', '/polymap_node', '/*/*', '/**/*', '/**/**', '/**/polymap_node',
        '**/polymap_node', '*/polymap_node', '/ns/*', '/ns/**', '/ns/**/polymap_node', '/ns/polymap_node',
        'ns/polymap_node', '/*/ns/*', '/a/**', '/**/ns/polymap_node', 'ns')
ORDERS = (('polymap_node', '/**'), ('/**', 'polymap_node'), ('/*', '/**/polymap_node', 'polymap_node'), ('*', '/*/*'))


def given(path, namespace='/'):
    """Parameters that a file gives to a real node."""
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', '--params-file', str(path)])
    node = rclpy.create_node('polymap_node', namespace=namespace, context=context, enable_rosout=False,
                             start_parameter_services=False, automatically_declare_parameters_from_overrides=True)
    found = {name: parameter.value for name, parameter in node.get_parameters_by_prefix('').items()}
    node.destroy_node()
    context.try_shutdown()
    return found


@pytest.mark.parametrize('namespace', ['/', '/ns'])
def test_a_key_is_for_the_nodes_for_which_it_is_to_ros(tmp_path, namespace):
    (tmp_path / 'p.yaml').write_text(''.join(
        f"'{key}': {{ros__parameters: {{p{number}: 1}}}}\n" for number, key in enumerate(KEYS)))
    theirs = given(tmp_path / 'p.yaml', namespace)
    full_name = f'{namespace.rstrip("/")}/polymap_node'
    assert {key for number, key in enumerate(KEYS) if f'p{number}' in theirs} == {
        key for key in KEYS if for_node(key, full_name)}


@pytest.mark.parametrize('keys', ORDERS, ids=str)
def test_of_several_keys_the_last_counts_as_for_ros(tmp_path, keys):
    (tmp_path / 'p.yaml').write_text(''.join(
        f"'{key}': {{ros__parameters: {{solver: {{seed: {number}}}}}}}\n" for number, key in enumerate(keys)))
    assert load_parameters(tmp_path / 'p.yaml').solver.seed == given(tmp_path / 'p.yaml')['solver.seed']


def test_a_key_without_a_value_is_told_with_its_likely_cause(tmp_path):
    (tmp_path / 'p.yaml').write_text('/**:\n  ros__parameters:\n    solver:\n    method: paper\n')
    with pytest.raises(UsageError, match=r'No value at line 3; a key with nothing .*indent its parameters below it'):
        init('polymap_node', ['--ros-args', '--params-file', str(tmp_path / 'p.yaml')], context=rclpy.Context())
