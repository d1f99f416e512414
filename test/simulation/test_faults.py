"""What a real device and its odometry do wrong: each fault is as strong and as frequent as said, and nothing else."""

import dataclasses

import numpy as np
import pytest
import scipy.signal

from polymap_ros.acoustics.matched_filter import MatchedFilter
from polymap_ros.acoustics.medium import make_medium
from polymap_ros.acoustics.pulse import make_pulse
from polymap_ros.geometry.image_sources import visible_images
from polymap_ros.parameters import SensorParameters
from polymap_ros.simulation.clearance import audible_feet, clearance, half_planes
from polymap_ros.simulation.faults import Faults
from polymap_ros.simulation.random_scenes import Recipe, driven, random_scene
from polymap_ros.simulation.waveforms import Synthesis, noise_free, simulate

SEED, EDGES = 4, 5


@pytest.fixture(scope='module')
def scene():
    return random_scene(SEED, EDGES)


@pytest.fixture(scope='module')
def plain(scene):
    return noise_free(scene)


def with_faults(scene, **faults):
    return dataclasses.replace(scene, faults=Faults(**faults))


def wave(scene, length_m):
    """One echo of amplitude 1 before spreading over this path."""
    synthesis = Synthesis(make_medium(scene.medium), make_pulse(scene.pulse), scene.n_samples, scene.period_s)
    return synthesis(np.array([length_m]), np.ones(1))


def test_without_their_first_echo_pings_lack_just_that_one(scene, plain):
    heard = noise_free(with_faults(scene, missing_first=0.2))
    changed = np.flatnonzero(np.any(heard != plain, axis=1))
    assert 5 <= len(changed) <= 20  # of 60, by chance within
    normals, offsets = half_planes(scene.vertices)
    for index in changed:
        nearest = 2.0 * (offsets - normals @ scene.positions[index]).min()
        np.testing.assert_allclose(plain[index] - heard[index], wave(scene, nearest), atol=1e-9)


def test_a_false_echo_is_nearer_than_the_first_and_as_strong(scene, plain):
    heard = noise_free(with_faults(scene, false_first=0.2))
    changed = np.flatnonzero(np.any(heard != plain, axis=1))
    assert 5 <= len(changed) <= 20
    ranges = 0.001 * np.arange(2000)
    correlate = MatchedFilter(make_medium(scene.medium), make_pulse(scene.pulse), ranges, scene.n_samples, 1e-6)
    normals, offsets = half_planes(scene.vertices)
    for index in changed:
        nearest = (offsets - normals @ scene.positions[index]).min()
        false = heard[index] - plain[index]
        place = ranges[np.abs(correlate(false)).argmax()]
        assert 0.2 * nearest - 0.001 <= place <= 0.9 * nearest + 0.001
        assert np.linalg.norm(false) == pytest.approx(np.linalg.norm(wave(scene, 2.0 * nearest)), rel=0.02)


def test_clutter_is_the_same_in_every_ping_as_strong_as_said_and_where_it_is_said(scene, plain):
    quiet = dataclasses.replace(with_faults(scene, direct_wave=10.0), snr_db=None)
    direct = simulate(quiet) - plain
    np.testing.assert_allclose(direct, np.broadcast_to(direct[0], direct.shape), atol=1e-9)
    echo_peak = np.median(np.abs(plain).max(axis=1))
    assert np.abs(direct[0]).max() == pytest.approx(10.0 * echo_peak)
    fixed = simulate(dataclasses.replace(with_faults(scene, clutter=10.0), snr_db=None))[0] - plain[0]
    ranges = 0.001 * np.arange(2000)
    correlate = MatchedFilter(make_medium(scene.medium), make_pulse(scene.pulse), ranges, scene.n_samples, 1e-6)
    envelope = np.abs(correlate(direct[0]))
    assert np.all(envelope[ranges > 0.15] < 0.02 * envelope.max())
    assert ranges[np.abs(correlate(fixed)).argmax()] == pytest.approx(0.4, abs=0.001)
    assert np.abs(fixed).max() == pytest.approx(10.0 * echo_peak)


def test_clutter_does_not_count_for_the_noise(scene):
    cluttered = with_faults(scene, direct_wave=10.0, clutter=10.0)
    quiet = dataclasses.replace(cluttered, snr_db=None)
    np.testing.assert_allclose(simulate(cluttered) - simulate(quiet),
                               simulate(scene) - simulate(dataclasses.replace(scene, snr_db=None)), atol=1e-9)


def test_the_second_mode_comes_early_by_the_ratio_of_the_speeds(scene, plain):
    other = noise_free(with_faults(scene, second_mode=0.1)) - plain
    assert np.mean(other**2) / np.mean(plain**2) == pytest.approx(0.01)
    nearest = visible_images(scene.vertices, scene.positions[0], 1).distance_m[0]
    envelope = np.abs(scipy.signal.hilbert(other[0]))
    first = scipy.signal.find_peaks(envelope, height=0.3 * envelope.max())[0][0] * 1e-6
    assert first == pytest.approx(nearest / 5264.0 + 1e-5, abs=4e-6)  # the pulse's centre is at 10 us


def test_emitter_and_receiver_apart_are_heard_over_the_paths_between_them():
    sensor = SensorParameters(x_m=0.01, baseline_x_m=0.03, baseline_y_m=0.04, baseline_z_m=0.02)
    scene = dataclasses.replace(random_scene(SEED, EDGES), sensor=sensor, order=1)
    emitters, receivers = scene.ends
    np.testing.assert_allclose(0.5 * (emitters + receivers), scene.positions)
    np.testing.assert_allclose(np.linalg.norm(receivers - emitters, axis=1), 0.05)
    normals, offsets = half_planes(scene.vertices)
    heard = noise_free(scene)
    for index in (0, 20, 40):
        # Mirror the receiver instead of the emitter in every wall whose point of reflection is on the edge.
        lengths = []
        for k, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
            e, r = (offset - place @ normal for place in (emitters[index], receivers[index]))
            hit = emitters[index] + e * normal + e / (e + r) * (receivers[index] + r * normal
                                                                - emitters[index] - e * normal)
            if audible_feet(scene.vertices, hit[None])[0, k]:
                lengths.append(np.sqrt(np.sum((emitters[index] + 2.0 * e * normal - receivers[index]) ** 2) + 0.02**2))
        synthesis = Synthesis(make_medium(scene.medium), make_pulse(scene.pulse), scene.n_samples, scene.period_s)
        np.testing.assert_allclose(heard[index], synthesis(np.array(lengths), np.ones(len(lengths))), atol=1e-9)


def test_odometry_of_a_wrong_scale_is_longer_and_drifts_by_the_way_travelled(scene):
    true = scene.poses
    steps = np.linalg.norm(np.diff(true[:, :2], axis=0), axis=1)
    longer = with_faults(scene, odometry_scale=1.02).reported_poses()
    np.testing.assert_allclose(np.linalg.norm(np.diff(longer[:, :2], axis=0), axis=1), 1.02 * steps)
    np.testing.assert_array_equal(longer[0], true[0])
    drifted = with_faults(scene, yaw_drift_deg_m=2.0).reported_poses()
    np.testing.assert_allclose(np.linalg.norm(np.diff(drifted[:, :2], axis=0), axis=1), steps)
    np.testing.assert_allclose(np.rad2deg(drifted[:, 2] - true[:, 2]), 2.0 * np.append(0.0, np.cumsum(steps)))
    # Every step points where the drifting heading, half way along, says.
    turn = np.angle(np.diff(drifted[:, :2] @ (1.0, 1j)) / np.diff(true[:, :2] @ (1.0, 1j)))
    np.testing.assert_allclose(np.rad2deg(np.unwrap(turn)), 2.0 * (np.cumsum(steps) - 0.5 * steps), atol=1e-9)


def test_a_recorded_drive_covers_the_room_as_a_drawn_path_does(scene):
    t = np.linspace(0.0, 1.0, 800)
    path = np.column_stack((20.0 * np.sin(7.0 * t), 12.0 * np.cos(5.0 * t), 6.0 * t))
    drive = driven(scene, path)
    assert (drive.vertices is scene.vertices, drive.poses.shape) == (True, (60, 3))
    assert clearance(drive.vertices, drive.positions).min() == pytest.approx(Recipe().clearance_m)
    assert audible_feet(drive.vertices, drive.positions).sum(axis=0).min() >= Recipe().feet_per_edge
    np.testing.assert_array_equal(drive.poses, driven(scene, path).poses)
    assert not np.allclose(drive.poses, driven(random_scene(SEED + 2, EDGES), path).poses)
