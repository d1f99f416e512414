import pytest

from polymap_ros.evaluation.trials import Trial


@pytest.fixture
def make_trial():
    """Make a trial that is right unless told otherwise."""
    def make(seed=1, edges=4, method='paper', right=True, **changes):
        values = {
            'scene': f'convex-{edges}-{seed}', 'seed': seed, 'edges': edges, 'method': method, 'snr_db': 0.0, 'run': 0,
            'status': 'closed', 'estimated_edges': edges, 'right': right, 'iou': 0.99,
            'offsets_m': (0.001, 0.002, 0.006), 'angles_deg': (0.1, 0.3, 0.2), 'z_r': (), 'z_theta': (),
            'z_length': (), 'z_angle': (), 'z_area': (),
            'least_likelihood': 0.95, 'certain_edges': edges, 'certain_real': edges, 'cautions': (), 'seconds': 0.5,
        }
        return Trial(**(values | changes))
    return make
