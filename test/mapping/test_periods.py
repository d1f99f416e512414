"""Sample periods that change between pings: each is heard as it was sampled, and all make one map."""

import dataclasses

import numpy as np

from polymap_ros.acoustics.ping import Ping
from polymap_ros.geometry.polygon_error import compare
from polymap_ros.geometry.pose import Pose
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.simulation.random_scenes import random_scene
from polymap_ros.simulation.waveforms import simulate

RATES_HZ = (1e6, 2e6, 0.7e6)


def mapped(rates_hz, snr_db, method):
    """A mapper that heard a scene whose pings were sampled at one rate after the other."""
    whole = dataclasses.replace(random_scene(1, 4), snr_db=snr_db)
    scenes = [dataclasses.replace(whole, sample_rate_hz=rate, n_samples=round(2048 * rate / 1e6)) for rate in rates_hz]
    samples = [simulate(scene) for scene in scenes]
    mapper = PolygonMapper(whole.parameters(Parameters()).replaced({'solver.method': method}))
    for k, (stamp_ns, pose) in enumerate(zip(whole.stamps_ns.tolist(), whole.poses.tolist(), strict=True)):
        turn = k % len(rates_hz)
        period_s = float(np.float32(1.0 / rates_hz[turn]))  # as a LaserScan says it
        mapper.add_pose(stamp_ns, Pose(*pose))
        mapper.add_ping(Ping(stamp_ns, samples[turn][k].astype(np.float32), period_s))
    assert mapper.counts.used == len(whole.poses)
    return mapper, whole


def test_the_map_does_not_depend_on_how_a_ping_was_sampled():
    mixed, _ = mapped(RATES_HZ, None, 'paper')
    alike, _ = mapped(RATES_HZ[:1], None, 'paper')
    peak = alike.beam_map.values.max()
    np.testing.assert_allclose(mixed.beam_map.values, alike.beam_map.values, atol=1e-3 * peak)
    np.testing.assert_allclose([each.rho for each in mixed.soundings], [each.rho for each in alike.soundings],
                               atol=1e-4)


def test_the_polygon_is_right_from_pings_of_three_rates():
    mapper, scene = mapped(RATES_HZ, 0.0, 'evidence')
    assert compare(mapper.solve().polygon.vertices, scene.vertices).right
