"""One ping from samples to a sounding at its place. Pure: no ROS, no files."""
