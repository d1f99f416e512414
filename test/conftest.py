"""The ROS environment of the tests: a domain of their own on this machine, fields of messages checked."""

import importlib.util
import os
import tempfile
from pathlib import Path

QUICK_DISCOVERY = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
  <participant profile_name="quick" is_default_profile="true"><rtps><builtin><discovery_config>
    <leaseDuration><sec>10</sec></leaseDuration>
    <leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
  </discovery_config></builtin></rtps></participant></profiles></dds>
"""


def _ros_environment(folder: Path) -> None:
    profile = folder / 'quick_discovery.xml'
    profile.write_text(QUICK_DISCOVERY)
    os.environ.update({
        'ROS_DOMAIN_ID': str(1 + os.getpid() % 100),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_PYTHON_CHECK_FIELDS': '1',
        'ROS_LOG_DIR': str(folder / 'log'),
        'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
        'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
    })
    os.environ.pop('ROS_LOCALHOST_ONLY', None)


if importlib.util.find_spec('rclpy') is not None:
    _FOLDER = tempfile.TemporaryDirectory(prefix='polymap_ros_test_')
    _ros_environment(Path(_FOLDER.name))
