"""The chair in Gazebo 11: the second simulator behind the same port."""
