"""A mapper that has heard a square room, without noise."""

import numpy as np
import pytest

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters

PARAMETERS = Parameters().replaced({
    'medium.model': 'constant', 'echo.kind': 'envelope', 'grid.range_max_m': 2.0, 'grid.range_step_m': 0.01,
    'grid.angle_step_deg': 2.0, 'solver.method': 'paper', 'solver.iterations': 40})


@pytest.fixture(scope='session')
def mapper():
    """Eight pings in a room of 1 m by 1 m about (3, 4), heading 30 degrees; the estimate is solved."""
    mapper = PolygonMapper(PARAMETERS)
    times_s = np.arange(1400) * 1e-5
    for k in range(8):
        x, y = 0.2 * np.cos(2.3 * k), 0.2 * np.sin(2.3 * k)
        delays_s = 2.0 * np.array([0.5 - x, 0.5 + x, 0.5 - y, 0.5 + y]) / 343.0 + 1e-5
        samples = np.exp(-((times_s[:, None] - delays_s) / 3e-5) ** 2).sum(axis=1)
        mapper.add_ping(Ping(k * 10**9, samples, 1e-5))
        mapper.add_pose(k * 10**9, Pose(3.0 + x, 4.0 + y, np.pi / 6), 'odom')
    mapper.solve()
    return mapper
