"""A task as a controller of ROS 2: a package of ros2_control."""
