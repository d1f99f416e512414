"""Paths over round walls: those of the simulator, which tries every sequence and looks for the shortest way."""

import numpy as np
import pytest

from polymap_ros.geometry.round_legs import is_hidden
from polymap_ros.geometry.round_ways import round_echoes
from polymap_ros.geometry.sides import outline_sides
from polymap_ros.simulation.reflectors import Reflectors, heard_images
from polymap_ros.simulation.round_paths import heard_paths

CORNERS = np.array([[0.0, 0.0], [1.4, 0.1], [1.3, 1.0], [0.7, 1.3], [0.1, 0.9]])
REFLECTION = np.array([0.9, -0.8, 1.0, 0.7, 0.95])
ONE, TWO = [[0.75, 0.55, 0.15, -0.8]], [[0.45, 0.5, 0.12, 1.0], [0.95, 0.6, 0.1, -0.9]]
PLACES = np.array([[0.25, 0.2], [1.15, 0.85], [0.7, 1.1]])


@pytest.mark.parametrize('circles', [ONE, TWO], ids=['one', 'two'])
@pytest.mark.parametrize('apart', [0.0, 0.04])
def test_paths_over_circles_are_those_of_every_sequence(circles, apart):
    circles, other = np.array(circles), PLACES + (apart, -0.5 * apart)
    sides, walls = outline_sides(CORNERS, 0.0, True), Reflectors.outline(CORNERS, REFLECTION)
    found = round_echoes(sides, REFLECTION, circles, np.column_stack((PLACES, other, np.zeros(3))), 4, 10.0)
    for number, (source, place) in enumerate(zip(PLACES, other, strict=True)):
        own = found.ping == number
        ours = np.column_stack((2.0 * found.half[own], found.strength[own]))
        all_of_them = np.column_stack(heard_paths(walls, circles, source, place, 4))
        images, amplitude = heard_images(walls, source, 4, place)
        straight = np.column_stack((np.linalg.norm(images - place, axis=1), amplitude))
        over = all_of_them[np.abs(all_of_them[:, None] - straight[None]).max(axis=2).min(axis=1) > 1e-6]
        thrice = len(over) - len(ours)  # over three circles, which are left out
        apart_by = np.abs(ours[:, None] - over[None]).max(axis=2)
        assert len(ours) > 60
        assert apart_by.min(axis=1).max() < 1e-6
        assert np.sum(apart_by.min(axis=0) > 1e-6) == thrice
        assert np.abs(over[apart_by.min(axis=0) > 1e-6, 1]).max(initial=0.0) < 0.15


def test_what_is_hidden_is_what_the_simulator_does_not_hear():
    walls, circles, (source, place) = Reflectors.outline(CORNERS), np.array(ONE), PLACES[:2]
    rows = outline_sides(CORNERS, 0.0, True).rows
    images, _ = heard_images(walls, source, 1, place)
    heard = heard_paths(walls, circles, source, place, 1)[0]
    gone = 0
    for wall, row in enumerate(rows):
        away = 2.0 * (row[2] - source @ row[:2])
        length = np.hypot(*(source + away * row[:2] - place))
        if np.abs(np.linalg.norm(images - place, axis=1) - length).min() < 1e-6:  # on the wall
            hidden = is_hidden(rows, np.array([wall]), circles, np.array([*source, *place, 0.0]))
            assert hidden == (np.abs(heard - length).min() > 1e-6)
            gone += hidden
    assert 0 < gone < len(rows)
    assert is_hidden(rows, np.empty(0, np.int64), circles, np.array([*source, *place, 0.0]))
