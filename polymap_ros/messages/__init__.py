"""Between ROS messages and the types of acoustics and mapping; duck-typed, so that rclpy and rosbags share it."""
