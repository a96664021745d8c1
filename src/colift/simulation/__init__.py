"""Simulation of the true system: dynamics, disturbances, actuators and sensors."""
