"""polymap_ros: the polygon around a robot from raw ultrasonic echoes and odometry."""

__version__ = '0.1.0'
