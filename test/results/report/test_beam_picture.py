"""The picture of the beamforming map is a sound PNG whose bright places lie in the frames."""

import base64
import io
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from polymap_ros.results.report.beam_picture import Marked, beam_map_svg, png
from polymap_ros.results.report.heard import Survey
from polymap_ros.solvers.estimate import Edge

Image = pytest.importorskip('PIL.Image')


def opened(content):
    return np.asarray(Image.open(io.BytesIO(content)).convert('RGB'))


def test_a_png_has_its_first_row_at_the_bottom_and_the_colours_of_the_scale():
    image = opened(png(np.array([[0.0, 0.5, 1.0], [1.0, 1.0, 1.0], [np.nan, -1.0, 2.0]], np.float32)))
    assert image.shape == (3, 3, 3)
    dark, bright = [0x44, 0x01, 0x54], [0xFD, 0xE7, 0x25]
    assert image[2][[0, 2]].tolist() == [dark, bright]
    assert image[2][1] == pytest.approx([0x21, 0x90, 0x8D], abs=1)
    assert image[0].tolist() == [dark, dark, bright]


def test_the_bright_places_are_framed(pages):
    document, heard = pages['square']
    edges = [Marked(str(i), edge['r'], edge['theta']) for i, edge in enumerate(document['edges'])]
    root = ElementTree.fromstring(beam_map_svg('a', heard, edges))
    picture = root.find('.//image')
    content = base64.b64decode(picture.get('href').removeprefix('data:image/png;base64,'))
    light = opened(content).astype(float) @ (0.3, 0.6, 0.1)
    left, top, width, height = (float(picture.get(name)) for name in ('x', 'y', 'width', 'height'))
    frames = [node for node in root.iter('rect') if 'mark-front' in node.get('class', '')]
    assert len(frames) == 4
    for frame in frames:
        x, y, w, h = (float(frame.get(name)) for name in ('x', 'y', 'width', 'height'))
        rows = slice(*(np.array([y - top, y + h - top]) / height * light.shape[0]).round().astype(int))
        columns = slice(*(np.array([x - left, x + w - left]) / width * light.shape[1]).round().astype(int))
        assert light[rows, columns].max() > 0.9 * light.max()


def test_a_wall_that_is_heard_from_both_sides_is_framed_on_the_one_that_the_map_has(pages):
    _, heard = pages['square']
    away = Edge(-0.3, 1.0, 1.0).moved(heard.start)
    svg = [beam_map_svg('a', heard, [Marked('W0', away.r, away.theta, both_sides=both)]) for both in (False, True)]
    assert [each.count('mark-front') for each in svg] == [0, 1]
    assert f'W0 at 0.300 m and {180.0 + np.rad2deg(1.0):.1f} degrees' in svg[1]


def test_large_maps_are_reduced_without_losing_a_peak():
    likelihood = np.zeros((720, 9601), np.float32)
    likelihood[333, 7777] = 1.0
    heard = Survey(np.zeros((1, 2)), None, likelihood, np.arange(720) * np.pi / 360.0, np.arange(9601) * 0.005)
    svg = beam_map_svg('a', heard, [])
    image = opened(base64.b64decode(re.search('base64,([^"]+)', svg)[1]))
    assert image.shape == (640, 640, 3)
    row, column = np.unravel_index(np.argmax(image[:, :, 0] == 0xFD), (640, 640))
    assert (639 - row) / 640 == pytest.approx(333 / 720, abs=2e-3)
    assert column / 640 == pytest.approx(7777 / 9601, abs=2e-3)
    assert len(svg) < 60_000


def test_a_window_of_angles_has_ticks_of_its_own(pages):
    _, heard = pages['square']
    svg = beam_map_svg('a', Survey(heard.path, heard.start, heard.likelihood[10:40], heard.theta_rad[10:40], heard.r_m),
                       [])
    assert '>50°<' in svg
    assert '>90°<' not in svg
