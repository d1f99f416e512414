"""The drawing is to scale, can be read, and loses nothing far from the origin."""

import math
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import shapely

from polymap_ros.results.report import labels
from polymap_ros.results.report.outline import candidates_svg, hole_svg, outline_svg, thumbnail_svg, walls_svg

CLOSED = ('square', 'triangle', 'ten', 'hall', 'long', 'high', 'utm')
SQUARE_PATH = np.array([[0.3, 0.2], [0.6, 0.2], [0.6, 0.5]])


def read(svg):
    return ElementTree.fromstring(svg)


def of_class(root, name):
    return [node for node in root.iter() if name in node.get('class', '').split()]


def points_of(node):
    return np.array(re.findall(r'(-?[\d.]+) (-?[\d.]+)', node.get('d')), dtype=float)


def texts(root):
    return [' '.join(''.join(node.itertext()).split()) for node in of_class(root, 'label')]


@pytest.mark.parametrize('name', CLOSED)
def test_lengths_in_the_drawing_are_those_of_the_edges(pages, name):
    document, heard = pages[name]
    corners = points_of(of_class(read(outline_svg('a', document, heard)), 'outline')[0])
    drawn = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    true = np.array([edge['length'] for edge in document['edges']])
    scale = drawn.sum() / true.sum()
    assert drawn == pytest.approx(scale * true, abs=0.02)  # two digits after the point
    assert drawn.max() > 110.0


def test_y_is_up_and_x_to_the_right(pages):
    document, heard = pages['square']
    corners = points_of(of_class(read(outline_svg('a', document, heard)), 'outline')[0])
    assert corners[1][0] > corners[0][0]
    assert corners[2][1] < corners[1][1]


@pytest.mark.parametrize('name', CLOSED)
def test_the_scale_bar_is_as_long_as_it_says(pages, name):
    document, heard = pages[name]
    root = read(outline_svg('a', document, heard))
    corners = points_of(of_class(root, 'outline')[0])
    per_metre = math.dist(corners[0], corners[1]) / document['edges'][0]['length']
    metres = float(texts(root)[-1].removesuffix(' m'))
    bar = float(re.search(r'h([\d.]+)', of_class(root, 'bar')[0].get('d'))[1])
    assert bar == pytest.approx(metres * per_metre, rel=2e-3)
    assert 40.0 < bar < 130.0


def test_edges_and_corners_are_labelled_with_deviations(pages):
    document, heard = pages['square']
    found = texts(read(outline_svg('a', document, heard, 'B')))
    assert found[:4] == [f'B{i} {length} m± 0.{std} mm' for i, (length, std) in enumerate(
        2 * [('1.0000', '30'), ('0.8000', '32')])]
    assert found[4:8] == 4 * ['90.00°± 0.016°']


def rings_of(node):
    return [points_of(ElementTree.Element('path', d=part)) for part in node.get('d').split('Z') if part]


def test_holes_are_left_unfilled_and_named_with_the_inner_walls(pages):
    document, heard = pages['pierced']
    root = read(outline_svg('a', document, heard))
    [outline] = of_class(root, 'outline')
    first, *inner = rings_of(outline)
    drawn = shapely.Polygon(first, inner)
    assert drawn.is_valid
    assert drawn.exterior.is_ccw is not drawn.interiors[0].is_ccw  # so that SVG's rule for filling leaves them out
    scale = np.ptp(drawn.exterior.coords, axis=0)[0] / 1.0
    assert drawn.area == pytest.approx(document['area'] * scale**2, rel=1e-3)
    [seam] = of_class(root, 'inner-wall')
    assert np.hypot(*np.diff(points_of(seam), axis=0)[0]) == pytest.approx(scale * math.hypot(0.03, 0.76), abs=0.02)
    assert texts(root)[8:11] == ['H0', 'H1', 'W0']
    assert 'Inside: hole H0, hole H1, inner wall W0.' in root.find('desc').text


@pytest.fixture
def boxes(monkeypatch):
    """Where labels are put, as they are drawn."""
    placed = []

    def best(places, lines, taken, ink):
        found = labels.best(places, lines, taken, ink)
        placed.append(found[1])
        return found

    monkeypatch.setattr('polymap_ros.results.report.outline.best', best)
    return placed


def test_a_hole_is_drawn_by_itself_with_its_sizes_around_it(pages, boxes):
    document, heard = pages['pierced']
    for hole in document['holes']:
        boxes.clear()
        root = read(hole_svg('a', hole, heard, 'H0.'))
        ring = shapely.Polygon(points_of(of_class(root, 'hole')[0]))
        assert [text.split()[0] for text in texts(root)[:len(hole['edges'])]] == [
            f'H0.{i}' for i in range(len(hole['edges']))]
        assert texts(root)[len(hole['edges'])].startswith(f'{math.degrees(hole["edges"][0]["angle"]):.2f}°')
        assert max(shapely.box(*box).intersection(ring).area for box in boxes) < 200.0
        assert not of_class(root, 'path')


def test_a_deviation_that_is_not_known_is_left_out(pages):
    document, heard = pages['square']
    edges = [{**edge, 'length_std': None, 'angle_std': None} for edge in document['edges']]
    found = texts(read(outline_svg('a', {**document, 'edges': edges}, heard)))
    assert found[0] == '0 1.00000 m'
    assert found[4] == '90.00°'


@pytest.mark.parametrize('name', CLOSED)
def test_labels_do_not_cover_each_other(pages, name, boxes):
    document, heard = pages[name]
    root = read(outline_svg('a', document, heard))
    assert len(boxes) == 2 * len(document['edges'])
    shared = [a.overlap(b) for i, a in enumerate(boxes) for b in boxes[:i]]
    assert max(shared) < 200.0  # of about 4000: a corner of the letters' box
    left, top, width, height = map(float, root.get('viewBox').split())
    assert all(left <= box.left + 1 and box.right <= left + width + 1 and top <= box.top + 1
               and box.bottom <= top + height + 1 for box in boxes)


def test_candidates_are_drawn_over_each_other_in_different_strokes(pages):
    document, heard = pages['ambiguous']
    root = read(candidates_svg('a', document['alternatives'], heard))
    assert [node.get('class') for node in of_class(root, 'outline')] == ['outline style0', 'outline style1']
    assert texts(root)[:2] == ['A', 'B']


def test_walls_run_through_the_drawing_and_not_beyond(pages):
    document, heard = pages['open']
    root = read(walls_svg('a', document['walls'], heard))
    assert len(of_class(root, 'wall')) == 2
    assert len(of_class(root, 'mirror')) == 1
    left, top, width, height = map(float, root.get('viewBox').split())
    for node in (*of_class(root, 'wall'), *of_class(root, 'mirror')):
        ends = points_of(node)
        assert np.all((ends >= (left, top)) & (ends <= (left + width, top + height)))
        assert math.dist(*ends) > 100.0


def test_a_robot_that_stood_still_is_drawn_as_a_place(pages):
    heard = pages['square'][1]
    still = type(heard)(np.full((9, 2), 5e6), heard.start, heard.likelihood, heard.theta_rad, heard.r_m)
    root = read(walls_svg('a', [], still))
    assert len(root.findall('.//circle')) == 2
    assert texts(root) == ['0.002 m']


def test_a_path_of_thousands_of_pings_stays_small(pages):
    document, heard = pages['square']
    turns = np.linspace(0.0, 600.0, 4096)
    path = np.column_stack((0.5 + 0.2 * np.cos(turns), 0.4 + 0.2 * np.sin(1.01 * turns)))
    svg = outline_svg('a', document, type(heard)(path, heard.start, heard.likelihood, heard.theta_rad, heard.r_m))
    assert 'circle class="start"' in svg
    assert svg.count('<circle') == 1
    assert len(svg) < 100_000


def test_a_thumbnail_has_the_holes(pages):
    [outline] = of_class(read(thumbnail_svg('a', 'b', [pages['pierced'][0]])), 'outline')
    assert outline.get('d').count('Z') == 3


def test_a_thumbnail_fits_its_frame():
    for scale in (0.2, 48.0, 5e6):
        points = points_of(of_class(read(thumbnail_svg('a', 'b', [{'vertices': scale * SQUARE_PATH}])), 'outline')[0])
        assert points.min() >= 2.9
        assert points.max() <= 45.1
