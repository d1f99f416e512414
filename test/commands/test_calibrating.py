"""polymap_replay --calibrate and --fit-odometry, and what a replay says when the medium is wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

BAG = Path(__file__).parents[2] / 'bags' / 'triangle'
WRONG = '-p', 'medium.thickness_m:=0.0075'


def document(folder):
    return json.loads((folder / 'polygon.json').read_text())


def test_the_medium_is_found_and_its_file_used_next_time(call, tmp_path):
    first = call('replay', BAG, *WRONG, '--calibrate', '--output', 'first')
    assert first.status == 0, first.err
    assert 'warning (calibrated): the map is made with medium.thickness_m 0.00' in first.out
    found = document(tmp_path / 'first')
    assert found['parameters']['medium.thickness_m'] == pytest.approx(0.006, rel=2e-4)
    assert [each['code'] for each in found['warnings']] == ['calibrated']
    second = call('replay', BAG, '--params-file', 'first/calibration.yaml', '--output', 'second')
    assert second.status == 0
    again = document(tmp_path / 'second')
    assert again['warnings'] == []
    np.testing.assert_allclose(again['vertices'], found['vertices'], atol=1e-5)
    assert not (tmp_path / 'second' / 'calibration.yaml').exists()


def test_a_replay_with_the_wrong_medium_says_what_fits(call, tmp_path):
    call('replay', BAG, *WRONG, '--output', 'out')
    text = next(each['text'] for each in document(tmp_path / 'out')['warnings'] if each['code'] == 'wrong_medium')
    assert '--calibrate' in text
    assert '-p medium.thickness_m:=0.00' in text


def test_only_one_thing_is_calibrated_and_from_the_recording_alone(call):
    with pytest.raises(SystemExit):
        call('replay', BAG, '--calibrate', '--fit-odometry')
    refused = call('replay', BAG, '--fit-odometry', '-p', 'output.load_path:=state.npz')
    assert refused.status == 2
    assert '--fit-odometry starts from a recording alone' in refused.err
