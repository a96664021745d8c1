"""Interfaces to Gymnasium, ROS 2, PX4, MCAP and embedded C code."""
