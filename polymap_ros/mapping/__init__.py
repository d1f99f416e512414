"""From soundings to the polygon: eqs. (4)-(10). Pure: no ROS, no files."""
