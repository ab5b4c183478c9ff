"""ROS messages to samples and back."""
