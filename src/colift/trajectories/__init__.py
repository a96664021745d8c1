"""Reference trajectories of the payload.

====================  ==================================================================
``base``              setpoint, protocol of a trajectory, exact derivatives of a pose
``lissajous``         sinusoidal position and attitude
``minimum_snap``      minimum-snap polynomials through waypoints
``departure``         smooth departure from another trajectory
====================  ==================================================================
"""
