"""The noise before the first echo, against noise of a level that is known."""

import dataclasses

import numpy as np
import pytest

from polymap_ros.evaluation.trials import filled_mapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.solvers.evidence.early_noise import early_noise
from polymap_ros.solvers.evidence.search import search_of

FIRST_M = np.full(60, 60.0)


def power(level, seed=1):
    """Independent cells of 60 pings, with an echo at cell 60, and weak ones before it in every tenth ping."""
    cells = level * np.random.default_rng(seed).exponential(size=(60, 100))
    cells[:, 58:62] += 100.0
    cells[::10, 30:34] += 20.0
    return cells


def test_other_noise_is_told_and_white_noise_is_not():
    for seed in range(20):
        assert early_noise(power(1.0, seed), 5, FIRST_M, 1.0, 1.0) == 1.0
        assert early_noise(power(0.5, seed), 5, FIRST_M, 1.0, 1.0) == pytest.approx(0.5, rel=0.15)
        assert early_noise(power(2.0, seed), 5, FIRST_M, 1.0, 1.0) == pytest.approx(2.0, rel=0.15)


def test_where_nothing_is_heard_before_the_first_echo_nothing_is_told():
    assert early_noise(power(3.0), 5, np.full(60, 6.0), 1.0, 1.0) == 1.0
    assert early_noise(power(3.0)[:1], 5, FIRST_M[:1] - 40.0, 1.0, 1.0) == 1.0  # 13 cells of one ping


@pytest.mark.parametrize('edges', [3, 8])
def test_of_coloured_noise_the_part_in_the_band_counts(edges):
    scene = dataclasses.replace(random_scene(2, edges), faults=Faults(noise_colour=0.9))
    mapper = filled_mapper(scene, Parameters())
    data = search_of(mapper.evidence, mapper.parameters).data
    normals = data.power[:, data.first_cell:]
    ranges = data.cell_m * np.arange(data.power.shape[1])[data.first_cell:]
    early = normals[ranges[None] < data.first_m[:, None] - 3.0 * data.pulse.width_m]
    assert np.median(early) / np.log(2.0) == pytest.approx(1.0, abs=0.2)
