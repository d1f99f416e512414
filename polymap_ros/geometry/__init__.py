"""Poses, planes, lines, polygons and the paths of sound between walls. Pure: no ROS, no files."""
