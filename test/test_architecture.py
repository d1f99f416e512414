"""The rules of the house, from the imports and the syntax trees: who may know whom, and who may touch what."""

import ast
import graphlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import polymap_ros

PACKAGE = Path(polymap_ros.__file__).parent
FILES = sorted(PACKAGE.rglob('*.py'))
SHARED = {'errors', 'parameters', 'specification', 'plain_yaml', 'cautions', 'packing', 'paths',
          'names', 'slam_parameters', 'result_parameters', 'map_parameters', 'echo_parameters'}
"""Modules beside the rooms that every room may import; the others are listed with the rooms that use them."""

_MAPPING = {'geometry', 'acoustics', 'hearing', 'maps', 'solvers', 'mapping'}
KNOWS = {
    'geometry': {'jit'},
    'acoustics': {'jit'},
    'hearing': {'geometry', 'acoustics'},
    'maps': {'geometry', 'hearing', 'jit'},
    'solvers': {'geometry', 'acoustics', 'hearing', 'maps', 'jit'},
    'mapping': {'geometry', 'acoustics', 'hearing', 'maps', 'solvers'},
    'calibration': {*_MAPPING, 'jit'},
    'simulation': {'geometry', 'acoustics', 'jit', 'pulse_file'},
    'messages': {'geometry', 'acoustics', 'solvers', 'mapping'},
    'results': {*_MAPPING, 'atomic', 'version'},
    'recordings': {*_MAPPING, 'messages', 'results', 'atomic'},
    'node': {*_MAPPING, 'messages', 'results', 'atomic', 'jit', 'pulse_file', 'version'},
    'evaluation': {*_MAPPING, 'calibration', 'simulation', 'results', 'jit', 'atomic', 'version'},
}
PURE = ('geometry', 'acoustics', 'hearing', 'maps', 'solvers', 'mapping', 'calibration')
PURE_PACKAGES = {'numpy', 'scipy', 'shapely', 'numba', 'polymap_ros'}
WORLDLY = {'logging', 'os', 'io', 'pathlib', 'sys', 'shutil', 'subprocess', 'tempfile', 'socket', 'random', 'time'}
WORLDLY_CALLS = {'open', 'print', 'input', 'exec', 'eval'}
NUMPY_FILES = {'load', 'save', 'savez', 'savez_compressed', 'savetxt', 'loadtxt', 'genfromtxt', 'fromfile', 'memmap'}
ROS = {
    'rclpy', 'ament_index_python', 'builtin_interfaces', 'std_msgs', 'sensor_msgs', 'geometry_msgs', 'nav_msgs',
    'visualization_msgs', 'diagnostic_msgs', 'std_srvs', 'rosgraph_msgs', 'rcl_interfaces', 'tf2_ros',
}
PICKLES = {'pickle', 'shelve', 'marshal', 'dill', 'cloudpickle', 'joblib'}


@cache
def tree(path):
    return ast.parse(path.read_text(encoding='utf-8'))


@cache
def imports(path):
    """Full names of all modules a file imports, at the top or inside functions."""
    found = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            found.update(f'{"." * node.level}{node.module}.{alias.name}' for alias in node.names)
    return found


def packages(path):
    return {name.partition('.')[0] for name in imports(path)}


def room(path):
    """Name of the room, or of the module beside the rooms, that a file of the package belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix('.py')


def neighbours(path):
    """Rooms and modules of the package that a file imports."""
    inside = [name.split('.')[1:] for name in imports(path) if name.split('.')[0] == 'polymap_ros']
    return {'version' if rest in ([], ['__version__']) else rest[0] for rest in inside}


def where(path, node=None):
    return f'{path.relative_to(PACKAGE)}{f":{node.lineno}" if node is not None else ""}'


def nodes(kind, files=FILES):
    return [(path, node) for path in files for node in ast.walk(tree(path)) if isinstance(node, kind)]


def is_name(node, *names):
    return isinstance(node, ast.Name) and node.id in names


def test_every_folder_is_a_room_with_rules():
    assert {path.parent.name for path in PACKAGE.glob('*/__init__.py')} == {*KNOWS, 'commands'}


def test_the_table_of_rooms_for_contributors_is_this_one():
    text = (Path(__file__).parents[1] / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| `(\w+)` \| .+ \| (.+) \|$', text, re.MULTILINE)
    assert dict(rows) == {name: ', '.join(sorted(known & KNOWS.keys())) or 'none' for name, known in KNOWS.items()} | {
        'commands': 'all'}


def test_a_room_knows_only_those_below_it():
    everything = {*KNOWS, 'library', 'parameter_file', 'pulse_file'}  # the door of the package
    knows = KNOWS | {'pulse_file': {'acoustics'}, 'library': {*_MAPPING, 'pulse_file'}, '__init__': everything}
    allowed = {path: knows.get(room(path), set()) | SHARED | {room(path)} for path in FILES}
    beyond = {where(path): neighbours(path) - allowed[path] for path in FILES if room(path) != 'commands'}
    assert {name: found for name, found in beyond.items() if found} == {}
    assert [where(path) for path in FILES if '' in packages(path)] == []  # a relative import


def test_the_rules_have_no_cycle_and_keep_recordings_and_node_apart():
    def known(name):
        below = KNOWS.get(name, set())
        return below.union(*(known(other) for other in below))  # a cycle would not end

    assert {'acoustics', 'mapping'} <= known('recordings') & known('node')
    assert 'node' not in known('recordings')
    assert 'recordings' not in known('node')


def test_no_module_leads_back_to_itself_by_its_imports():
    """Those inside functions, and for types alone, included."""
    modules = {'.'.join(path.relative_to(PACKAGE.parent).with_suffix('').parts): path for path in FILES}
    graph = {name: {each if each in modules else each.rpartition('.')[0] for each in imports(path)} & modules.keys()
             for name, path in modules.items()}
    assert graph['polymap_ros.mapping.mapper']
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def test_the_rooms_of_the_method_are_pure():
    files = [path for path in FILES if room(path) in PURE or path.stem in ('cautions', 'packing')]
    foreign = {where(path): packages(path) - set(sys.stdlib_module_names) - PURE_PACKAGES for path in files}
    worldly = {where(path): packages(path) & WORLDLY for path in files}
    assert [name for name in foreign if foreign[name] or worldly[name]] == []
    calls = [where(path, node) for path, node in nodes(ast.Call, files) if is_name(node.func, *WORLDLY_CALLS)]
    calls += [where(path, node) for path, node in nodes(ast.Attribute, files)
              if is_name(node.value, 'np') and node.attr in NUMPY_FILES]
    calls += [where(path, node) for path, node in nodes((ast.Global, ast.Nonlocal), files)]
    assert calls == []


def test_every_random_number_comes_from_a_seeded_generator():
    assert [where(path) for path in FILES if 'random' in imports(path)] == []
    offenders = [
        where(path, node) for path, node in nodes(ast.Attribute)
        if isinstance(node.value, ast.Attribute) and node.value.attr == 'random'
        and node.attr not in ('Generator', 'default_rng', 'SeedSequence')
    ]
    offenders += [
        where(path, node) for path, node in nodes(ast.Call)
        if isinstance(node.func, ast.Attribute) and node.func.attr == 'default_rng' and not node.args
    ]
    assert offenders == []


def test_only_node_imports_ros():
    assert [where(path) for path in FILES if room(path) != 'node' and packages(path) & ROS] == []
    assert any('rclpy' in packages(path) for path in FILES)


def test_only_commands_exit():
    assert [where(path, node) for path, node in nodes(ast.Attribute)
            if room(path) != 'commands' and is_name(node.value, 'sys', 'os')
            and node.attr in ('exit', '_exit', 'abort')] == []


def test_nothing_is_pickled():
    assert [where(path) for path in FILES if packages(path) & PICKLES] == []
    assert [where(path, node.value) for path, node in nodes(ast.keyword)
            if node.arg == 'allow_pickle' and not (isinstance(node.value, ast.Constant) and node.value.value is False)
            ] == []


def test_no_exception_is_swallowed():
    assert [where(path, node) for path, node in nodes(ast.ExceptHandler)
            if node.type is None or (is_name(node.type, 'Exception', 'BaseException')
                                     and all(isinstance(step, ast.Pass) for step in node.body))] == []


def test_files_and_functions_are_small():
    """Up to 350 lines, and 60 without the docstring."""
    assert [where(path) for path in FILES if len(path.read_text(encoding='utf-8').splitlines()) > 350] == []
    lengths = {(path, node): node.end_lineno - (node.body[0].end_lineno if ast.get_docstring(node) else node.lineno)
               for path, node in nodes(ast.FunctionDef)}
    assert [f'{where(path, node)} {node.name}' for (path, node), length in lengths.items() if length > 60] == []


def named(kind):
    """Where each name is given to a class, or to a value, at the top of a module: file and what it is."""
    found = {}
    for path in FILES:
        for node in tree(path).body:
            if kind is ast.ClassDef and isinstance(node, ast.ClassDef):
                found.setdefault(node.name, {})[where(path)] = node.name
            elif kind is ast.Assign and isinstance(node, ast.Assign):
                for target in node.targets:
                    pairs = zip(target.elts, getattr(node.value, 'elts', [node.value] * len(target.elts)), strict=False
                                ) if isinstance(target, ast.Tuple) else [(target, node.value)]
                    for name, value in pairs:
                        if isinstance(name, ast.Name):
                            found.setdefault(name.id, {})[where(path)] = ast.unparse(value)
    return found


def test_no_two_classes_have_one_name():
    assert {name: sorted(files) for name, files in named(ast.ClassDef).items() if len(files) > 1} == {}


def test_no_two_public_functions_have_one_name():
    """But for the entry points, and for what makes messages: of rclpy and of rosbags."""
    names = {}
    for path in FILES:
        for node in tree(path).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith('_'):
                names.setdefault(node.name, []).append(where(path))
    assert {name: files for name, files in names.items() if len(files) > 1 and name not in ('main', 'make')} == {}


def test_in_the_rooms_of_the_method_a_constant_has_one_value():
    """Elsewhere a name may be a module's own; what decides about walls is known by one name and one number."""
    inside = {name: {file: value for file, value in places.items() if file.partition('/')[0] in PURE}
              for name, places in named(ast.Assign).items() if name.isupper()}
    assert {name: places for name, places in inside.items() if len(set(places.values())) > 1} == {}


@pytest.mark.parametrize('module', [
    'polymap_ros', *(f'polymap_ros.commands.{name}' for name in ('replay', 'simulate', 'evaluate', 'node', 'play'))])
def test_importing_is_light(module):
    """Neither the package nor a command brings in what takes long, so that --help answers at once."""
    assert imported(module) & {'rclpy', 'rosbags', 'matplotlib', 'mcap', 'numpy', 'scipy', 'shapely'} == set()


def test_the_pure_rooms_bring_in_nothing_of_the_world():
    modules = ['.'.join(path.relative_to(PACKAGE.parent).with_suffix('').parts) for path in FILES if room(path) in PURE]
    found = imported(*(module.removesuffix('.__init__') for module in modules))
    assert 'numpy' in found
    assert found & {'rclpy', 'rosbags', 'matplotlib', 'mcap', 'scipy.signal', 'scipy.stats'} == set()


def imported(*modules):
    """Names of the modules that a fresh interpreter holds after importing."""
    run = subprocess.run([sys.executable, '-c', f'import sys, {", ".join(modules)}; print(*sys.modules)'],
                         capture_output=True, text=True, check=True, timeout=60)
    return set(run.stdout.split())


def test_tests_that_are_called_heavy_are_there():
    tests = Path(__file__).parent
    listed = next(ast.literal_eval(node.value) for node in ast.parse((tests / 'conftest.py').read_text()).body
                  if isinstance(node, ast.Assign) and is_name(node.targets[0], 'HEAVY'))
    found = {node.name for path in tests.rglob('test_*.py') for node in ast.parse(path.read_text()).body
             if isinstance(node, ast.FunctionDef)}
    assert listed - found == set()
