"""Acoustics: medium, pulse, eq. (3), noise, ranges. Pure: no ROS, no files."""
