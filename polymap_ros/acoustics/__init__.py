"""Acoustics: medium, pulse, eq. (3), ranges, image sources. Pure: no ROS, no files."""
