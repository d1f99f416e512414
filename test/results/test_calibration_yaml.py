"""calibration.yaml is a parameter file that the tools and the node take."""

from polymap_ros.parameter_file import load_parameters
from polymap_ros.results.calibration_yaml import calibration_yaml


def test_what_was_found_is_read_back(tmp_path):
    values = {'medium.thickness_m': 0.00612345678, 'medium.shear_speed_m_s': 3100.0, 'odometry.scale': 1.0}
    path = tmp_path / 'calibration.yaml'
    path.write_bytes(calibration_yaml(values, dict.fromkeys(values, 1e-6)))
    read = load_parameters(path)  # 3100.0 and 1.0 as doubles, or they would be refused
    for name, value in values.items():
        assert abs(float(read[name]) / value - 1.0) < 1e-7
    assert '+- 1e-06' in path.read_text()
