"""What pings add up to: the map of eq. (4), the free area, the places visited. Pure: no ROS, no files."""
