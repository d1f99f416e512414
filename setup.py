from setuptools import find_packages, setup

NAME = 'polymap_ros'

setup(
    name=NAME,
    version='0.1.0',
    description='Maps the polygon around a robot from raw ultrasonic echoes and odometry (ROS 2)',
    long_description='See README.md',
    license='Apache-2.0',
    author='The polymap_ros maintainers',
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['py.typed', 'config/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
    ],
    zip_safe=False,
    install_requires=[
        'numpy>=1.26',
        'scipy>=1.11',
        'shapely>=2.0',
        'numba>=0.59',
        'pyyaml>=6.0',
        'tqdm>=4.64',
        'mcap>=1.1,<2',
        'rosbags>=0.10,<0.12',
    ],
    extras_require={
        'ros': [
            'ros-rclpy[fastrtps]==7.1.6',
            'ros-nav-msgs==5.3.6',
            'ros-sensor-msgs==5.3.6',
            'ros-geometry-msgs==5.3.6',
            'ros-visualization-msgs==5.3.6',
            'ros-diagnostic-msgs==5.3.6',
            'ros-std-srvs==5.3.6',
        ],
        'plot': ['matplotlib>=3.6'],
        'test': ['pytest>=7.4', 'matplotlib>=3.6', 'pyroomacoustics>=0.7', 'hypothesis>=6.90'],
        'lint': ['ruff', 'mypy', 'types-PyYAML', 'types-tqdm'],
    },
    entry_points={
        'console_scripts': [
            'polymap_node = polymap_ros.commands.node:main',
            'polymap_replay = polymap_ros.commands.replay:main',
            'polymap_play = polymap_ros.commands.play:main',
            'polymap_simulate = polymap_ros.commands.simulate:main',
            'polymap_evaluate = polymap_ros.commands.evaluate:main',
        ],
    },
)
