"""What makes the folder a ROS package and a Python package, and that both say the same."""

import ast
import importlib
import importlib.metadata
import re
import subprocess
import sys
import types
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

import polymap_ros
from polymap_ros.simulation import scene_file

TOP = Path(__file__).parents[1]
MANIFEST = ElementTree.parse(TOP / 'package.xml').getroot()
DISTRIBUTION = importlib.metadata.distribution('polymap_ros')

COMMANDS = ('polymap_node', 'polymap_replay', 'polymap_play', 'polymap_simulate', 'polymap_evaluate')
FROM_PIP = {'mcap', 'rosbags', 'lz4', 'zstandard'}
"""Imported where a recording is read; no system package brings them."""

OPTIONAL = {'matplotlib', 'PIL', 'ezdxf', 'jinja2', 'distributed'}
"""Imported where a picture, a DXF, a page or a cluster is asked for."""

BROUGHT_BY = {'yaml': 'python3-yaml', 'tf2_ros': 'tf2_ros_py'}


def imported():
    """Every package that polymap_ros imports, and every message package it names."""
    names = set()
    for path in (TOP / 'polymap_ros').rglob('*.py'):
        source = path.read_text(encoding='utf-8')
        names.update(re.findall(r"['\"](\w+)/(?:msg|srv)/\w+['\"]", source))
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Import):
                names.update(alias.name.partition('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                names.add((node.module or '').partition('.')[0])
    return names - set(sys.stdlib_module_names) - {'polymap_ros'}


def test_one_version():
    version = MANIFEST.findtext('version')
    assert polymap_ros.__version__ == version == DISTRIBUTION.version
    assert str(yaml.safe_load((TOP / 'CITATION.cff').read_text())['version']) == version
    assert re.search(rf'^{re.escape(version)} \(.+\)\n-+$', (TOP / 'CHANGELOG.rst').read_text(), re.MULTILINE)


def test_manifest_declares_what_is_imported_and_no_more():
    ros = {name for name in imported() if name.endswith(('_msgs', '_srvs', '_interfaces')) or name == 'rclpy'}
    others = imported() - ros - FROM_PIP - OPTIONAL - {'ament_index_python'}
    keys = {BROUGHT_BY.get(name, f'python3-{name}') for name in others}
    declared = {entry.text for entry in MANIFEST.findall('exec_depend')}
    assert ros | keys <= declared
    # std_msgs' Header and builtin_interfaces' Time come within the other messages.
    assert declared - ros - keys <= {'builtin_interfaces', 'std_msgs'}


def test_the_tools_of_catkin_read_manifest_and_changelog():
    manifest = pytest.importorskip('catkin_pkg.package').parse_package(str(TOP / 'package.xml'), warnings=(told := []))
    manifest.validate(warnings=told)
    assert told == []
    changelog = pytest.importorskip('catkin_pkg.changelog').get_changelog_from_path(str(TOP), manifest.name)
    released = [version for version, _, items in changelog.foreach_version(reverse=True) if items]
    assert released[0] == manifest.version
    headings = re.findall(r'^(\S+).*\n-+$', (TOP / 'CHANGELOG.rst').read_text(encoding='utf-8'), re.MULTILINE)
    assert [heading for heading in headings if heading != 'Forthcoming'] == released


def test_manifest_is_a_valid_ament_python_package():
    assert MANIFEST.get('format') == '3'
    assert MANIFEST.findtext('name') == 'polymap_ros'
    assert MANIFEST.findtext('export/build_type') == 'ament_python'
    assert re.fullmatch(r'[^@\s]+@[^@\s]+\.[a-z]{2,}', MANIFEST.find('maintainer').get('email'))
    licence = MANIFEST.find('license')
    assert licence.text in (TOP / 'CITATION.cff').read_text()
    assert 'Apache License' in (TOP / licence.get('file')).read_text()


def test_ament_finds_the_package_and_its_executables():
    assert (TOP / 'resource' / 'polymap_ros').is_file()
    setup_cfg = (TOP / 'setup.cfg').read_text()
    assert setup_cfg.count('$base/lib/polymap_ros') == 2


@pytest.mark.parametrize('command', COMMANDS)
def test_every_command_is_installed_and_has_its_own_module(command):
    [entry] = [entry for entry in DISTRIBUTION.entry_points if entry.name == command]
    assert entry.value == f'polymap_ros.commands.{command.removeprefix("polymap_")}:main'
    assert callable(entry.load())
    assert {entry.name for entry in DISTRIBUTION.entry_points} == set(COMMANDS)


def test_a_folder_of_this_name_does_not_hide_the_package(tmp_path):
    """Such as the clone, in whose parent a newcomer starts Python, or one of results; scenes are found all the same."""
    (tmp_path / 'polymap_ros').symlink_to(TOP)
    code = ("import polymap_ros; print(polymap_ros.__version__); from polymap_ros.simulation import scene_file; "
            "print(len(scene_file.load_scene('triangle').vertices))")
    run = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert run.stdout.split() == [polymap_ros.__version__, '3'], run.stderr


def test_scenes_are_found_without_the_package_s_own_file(monkeypatch):
    """Where it is a namespace package, as for an editable install that comes after a folder of this name."""
    namespace = types.ModuleType('polymap_ros')
    namespace.__path__ = polymap_ros.__path__
    monkeypatch.setitem(sys.modules, 'polymap_ros', namespace)
    assert scene_file.built_in_scenes() == [
        'l_shape', 'pentagon', 'quadrilateral', 'rectangle', 'room', 'triangle']


def test_types_and_configuration_are_installed():
    package = importlib.resources.files('polymap_ros')
    assert (package / 'py.typed').is_file()
    for name in ('polymap.yaml', 'polymap.rviz', 'polymap.foxglove.json'):
        assert (package / 'config' / name).is_file()
    for name in ('base.html', 'report.html', 'index.html', 'tables.html', 'style.css'):
        assert (package / 'results' / 'report' / 'templates' / name).is_file()
