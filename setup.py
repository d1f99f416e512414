from pathlib import Path

from setuptools import find_packages, setup

NAME = 'polymap_ros'
ROS_WHEELS = 'platform_machine == "x86_64" and sys_platform == "linux"'

setup(
    name=NAME,
    version='0.1.0',
    description='Maps the polygon around a robot from raw ultrasonic echoes and odometry (ROS 2)',
    long_description=Path(__file__).resolve().with_name('README.md').read_text(encoding='utf-8'),  # colcon links here
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    author='The polymap_ros maintainers',
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_dir={'': '.'},  # an editable install is then found before a folder of this name, such as the clone itself
    package_data={NAME: ['py.typed', 'config/*', 'results/report/templates/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', sorted(map(str, Path(NAME, 'config').glob('*')))),
    ],
    zip_safe=False,
    install_requires=[
        'numpy>=1.26,<3',
        'scipy>=1.11,<2',
        'shapely>=2.0.2,<3',
        'numba>=0.59,<1',
        'pyyaml>=6.0.1,<7',
        'tqdm>=4.64,<5',
        'mcap>=1.1,<2',
        'rosbags>=0.11.6,<0.12',
        'lz4>=4.0,<5',
        'zstandard>=0.19,<1',
    ],
    extras_require={
        # What apt brings on a Jazzy machine. Wheels exist for Linux on x86_64 only.
        'ros': [f'{package}; {ROS_WHEELS}' for package in (
            'ros-rclpy[fastrtps]==7.1.6',
            'ros-nav-msgs==5.3.6',
            'ros-sensor-msgs==5.3.6',
            'ros-geometry-msgs==5.3.6',
            'ros-visualization-msgs==5.3.6',
            'ros-diagnostic-msgs==5.3.6',
            'ros-std-srvs==5.3.6',
        )],
        'plot': ['matplotlib>=3.6,<4'],
        'export': ['ezdxf>=1.1,<2'],
        'fleet': ['distributed>=2024.1'],
        'report': ['jinja2>=3.1,<4'],
        'test': ['pytest>=7.4,<10', 'pytest-xdist>=3.3,<4', 'matplotlib>=3.6,<4', 'ezdxf>=1.1,<2', 'jinja2>=3.1,<4',
                 'distributed>=2024.1', 'pyroomacoustics>=0.7,<1', 'hypothesis>=6.90,<7',
                 'catkin_pkg>=1.0,<2'],
        'fuzz': ['atheris>=2.3,<4'],
        'mutation': ['pytest-cov>=4,<8', 'pytest-timeout>=2.2,<3'],
        'doc': ['sphinx>=8.1,<10', 'myst-parser>=4,<6', 'numpydoc>=1.9,<2', 'furo>=2024.8.6'],
        'lint': ['ruff>=0.17,<0.18', 'mypy>=2.4,<2.5', 'types-PyYAML', 'types-tqdm'],
    },
    entry_points={
        'console_scripts': [
            f'polymap_{name} = {NAME}.commands.{name}:main'
            for name in ('node', 'replay', 'play', 'simulate', 'evaluate')
        ],
    },
)
