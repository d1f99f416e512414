import pickle

import pytest

from polymap_ros.errors import BadPing, ParameterError, SceneError


@pytest.mark.parametrize('error', [
    ParameterError('grid.range_step_m', 'must be above 0'), BadPing('bad_samples', 'all zero'), SceneError('no room')])
def test_errors_come_back_whole_from_another_process(error):
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)
