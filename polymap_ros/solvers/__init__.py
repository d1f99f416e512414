"""From soundings and maps to the polygon: `evidence`, `paper`, `rectangle`. Pure: no ROS, no files."""
