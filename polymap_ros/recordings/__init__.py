"""Reading, writing and replaying rosbag2 and mcap recordings."""
