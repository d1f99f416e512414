"""The way through: from poses and pings to the polygon. Pure: no ROS, no files."""
