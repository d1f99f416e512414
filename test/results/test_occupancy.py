"""The grid against shapely cell by cell, and the files as Nav2's map server takes them."""

import numpy as np
import pytest
import shapely
import yaml
from scipy import ndimage

from polymap_ros.parameters import Parameters
from polymap_ros.results.map_files import map_yaml, pgm
from polymap_ros.results.occupancy import FREE, OCCUPIED, UNKNOWN, cell_size, occupancy, occupancy_of
from polymap_ros.results.save import map_files
from polymap_ros.solvers.estimate import Candidate, Edge, Estimate, InnerWall

TRIANGLE = [[0.013, 0.007], [1.2, 0.0], [0.4, 0.9]]
PENTAGON = [[0, 0], [1, 0], [1.3, 0.7], [0.6, 1.2], [-0.2, 0.6]]
DIAMOND = [[0, -1], [1, 0], [0, 1], [-1, 0]]


@pytest.mark.parametrize('vertices', [TRIANGLE, PENTAGON, DIAMOND, np.array(TRIANGLE) * 1e-4, np.array(PENTAGON) - 50])
def test_every_cell_agrees_with_shapely(vertices):
    size = np.ptp(vertices, axis=0).max()
    grid = occupancy(vertices, size / 37.3, size / 10)
    room = shapely.Polygon(vertices)
    for row, column in np.ndindex(*grid.cells.shape):
        x, y = np.array(grid.origin) + grid.resolution_m * np.array([column, row])
        cell = shapely.box(x, y, x + grid.resolution_m, y + grid.resolution_m)
        if (distance := cell.distance(room.boundary)) > 1e-5 * grid.resolution_m:
            inside = room.contains(cell.centroid)
            assert grid.cells[row, column] == (FREE if inside else UNKNOWN), (row, column)
        elif distance == 0.0 and cell.intersection(room.boundary).length > 1e-6 * size:
            assert grid.cells[row, column] == OCCUPIED, (row, column)


@pytest.mark.parametrize('vertices', [DIAMOND, PENTAGON, TRIANGLE, [[0, 0], [1, 0], [1, 0.5], [0, 0.5]]])
@pytest.mark.parametrize('resolution', [0.05, 0.013])
def test_free_cells_are_enclosed_even_for_diagonal_steps(vertices, resolution):
    cells = occupancy(vertices, resolution, 0.1).cells
    labels, _ = ndimage.label(cells != OCCUPIED, structure=np.ones((3, 3)))
    assert labels[0, 0] not in labels[cells == FREE]
    assert np.all(cells[labels == labels[0, 0]] == UNKNOWN)


def test_the_border_is_as_wide_as_asked():
    grid = occupancy([[0.01, 0.01], [0.99, 0.01], [0.99, 0.99], [0.01, 0.99]], 0.02, 0.1)
    rows, columns = np.nonzero(grid.cells != UNKNOWN)
    assert (columns.min() * 0.02, rows.min() * 0.02) == pytest.approx((0.1, 0.1), abs=0.021)
    assert grid.origin == pytest.approx((-0.1, -0.1), abs=1e-12)
    assert grid.cells.shape[1] - 1 - columns.max() >= 5


SLOT = [[0.3, 0.3], [0.25, 0.7], [0.62, 0.75], [0.7, 0.28]]
STUD = [[0.85, 0.2], [1.0, 0.3], [1.02, 0.15]]
SEAM = [[0.4, 0.9], [1.0, 0.6]]


def closed(vertices, holes=(), inner_walls=()):
    ring = [Candidate(np.asarray(each, dtype=float), ()) for each in (vertices, *holes)]
    return Estimate('closed', 'evidence', polygon=ring[0], holes=tuple(ring[1:]), inner_walls=tuple(
        InnerWall(np.array(start), np.array(end), Edge(0.0, 0.0, 1.0), 0.3, 0.9) for start, end in inner_walls))


def test_holes_are_as_outside_and_inner_walls_as_walls():
    """Every cell against shapely."""
    parameters = Parameters().replaced({'map.resolution_m': 0.021})
    grid = occupancy_of(closed(PENTAGON, [SLOT, STUD], [SEAM]), parameters)
    room = shapely.Polygon(PENTAGON, [SLOT, STUD])
    walls = shapely.union(room.boundary, shapely.LineString(SEAM))
    for row, column in np.ndindex(*grid.cells.shape):
        x, y = np.array(grid.origin) + grid.resolution_m * np.array([column, row])
        cell = shapely.box(x, y, x + grid.resolution_m, y + grid.resolution_m)
        if (distance := cell.distance(walls)) > 1e-5 * grid.resolution_m:
            assert grid.cells[row, column] == (FREE if room.contains(cell.centroid) else UNKNOWN), (row, column)
        elif distance == 0.0 and cell.intersection(walls).length > 1e-6:
            assert grid.cells[row, column] == OCCUPIED, (row, column)


def test_the_files_of_a_map_have_them_too(tmp_path):
    answer = closed(PENTAGON, [SLOT, STUD], [SEAM])
    [entry] = map_files(answer, Parameters())
    entry.write(tmp_path)
    description = yaml.safe_load((tmp_path / 'map.yaml').read_text())
    np.testing.assert_array_equal(read_as_map_server((tmp_path / 'map.pgm').read_bytes(), description),
                                  occupancy_of(answer, Parameters()).cells)


def test_no_way_leads_into_a_hole_or_through_a_seam():
    cells = occupancy(square(1.0), 0.013, 0.1, [SLOT], [[[0.0, 0.8], [1.0, 0.9]]]).cells
    labels, number = ndimage.label(cells == FREE, structure=np.ones((3, 3)))
    assert number == 2
    labels, _ = ndimage.label(cells != OCCUPIED, structure=np.ones((3, 3)))
    within = labels[cells.shape[0] // 2, cells.shape[1] // 2]
    assert np.all(cells[labels == within] == UNKNOWN)


def test_an_end_beyond_the_grid_marks_nothing_elsewhere():
    without, cells = (occupancy(square(1.0), 0.05, 0.1, inner_walls=walls).cells
                      for walls in ([], [[[-0.4, 0.525], [0.52, 0.525]]]))
    rows, columns = np.nonzero(cells != without)
    assert set(rows) == {12}
    assert set(columns) == {0, *range(3, 13)}  # but for those of the outline


def square(side_m):
    return [[0, 0], [side_m, 0], [side_m, side_m], [0, side_m]]


def test_a_large_place_has_larger_cells_and_is_told_so():
    """The hall is 48 x 44 m: at 5 mm 85 million cells."""
    hall = [[0, 0], [48, 0], [48, 44], [0, 44]]
    size = cell_size(hall, Parameters())
    assert (size.resolution_m, size.caution.code) == (0.01, 'map_coarse')
    assert size.caution.text.startswith('the cells of the map are 0.01 m wide, not 0.005 m')
    grid = occupancy_of(closed(hall), Parameters())
    assert grid.resolution_m == 0.01
    assert np.count_nonzero(grid.cells == FREE) == pytest.approx(48 * 44 / 0.01**2, rel=1e-3)


@pytest.mark.parametrize(('side_m', 'expected_m'), [(34.0, 0.005), (37.0, 0.01), (1e3, 0.25), (1e7, 2500.0)])
def test_the_cells_are_no_larger_than_they_need_to_be(side_m, expected_m):
    chosen_m = cell_size(square(side_m), Parameters()).resolution_m
    assert chosen_m == pytest.approx(expected_m)


@pytest.mark.parametrize('given_m', [0.005, 1e-6])
def test_a_size_that_was_asked_for_is_kept_or_costs_the_map(given_m):
    parameters = Parameters().replaced({'map.resolution_m': given_m})
    size = cell_size(square(50.0), parameters)
    assert (size.resolution_m, size.caution.code) == (None, 'map_too_large')
    assert size.caution.text.startswith('there is no map: a place of 50 x 50 m has ')
    assert f'cells of {given_m:g} m' in size.caution.text
    assert size.caution.remedy == 'set map.resolution_m to 0.01, or to 0, which chooses it by itself'
    assert occupancy_of(closed(square(50.0)), parameters) is None
    assert cell_size(square(1.0), Parameters().replaced({'map.resolution_m': 0.01})) == (0.01, None)


@pytest.mark.parametrize('corner', [np.inf, np.nan, 1e300])
def test_a_place_without_a_size_has_no_map(corner):
    size = cell_size([[0, 0], [corner, 0], [1, 1]], Parameters())
    assert (size.resolution_m, size.caution.code) == (None, 'map_too_large')
    with pytest.raises(ValueError, match='cells'):
        occupancy([[0, 0], [corner, 0], [1, 1]], 0.005, 0.0)


def read_as_map_server(image, description):
    """Nav2's nav2_map_server, trinary mode: thresholds on 1 - pixel / 255, rows from the top."""
    magic, size, depth, pixels = image.split(b'\n', 3)
    columns, rows = map(int, size.split())
    assert (magic, depth, len(pixels)) == (b'P5', b'255', rows * columns)
    p = 1.0 - np.frombuffer(pixels, np.uint8).reshape(rows, columns)[::-1] / 255.0
    assert (description['mode'], description['negate']) == ('trinary', 0)
    free = np.where(p < description['free_thresh'], 0, -1)
    return np.where(p > description['occupied_thresh'], 100, free)


def test_the_map_server_reads_back_the_same_cells():
    grid = occupancy(PENTAGON, 0.02, 0.1)
    description = yaml.safe_load(map_yaml(grid))
    np.testing.assert_array_equal(read_as_map_server(pgm(grid), description), grid.cells)
    assert set(np.unique(grid.cells)) == {-1, 0, 100}
    assert description['image'] == 'map.pgm'
    assert description['resolution'] == 0.02
    assert description['origin'] == pytest.approx([-0.3, -0.1, 0.0], abs=0.0201)
