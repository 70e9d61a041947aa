"""From arriving messages to results, without ROS."""
