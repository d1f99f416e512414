"""Medium, odometry and time zero from the echoes themselves. Pure: no ROS, no files."""
