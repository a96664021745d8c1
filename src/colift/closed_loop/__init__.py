"""Closed-loop simulation of world and controller, linearization, and logs."""
