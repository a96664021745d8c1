"""Models of the team: parameters, states, kinematics and dynamics, and exchange formats.

- `parameters`, `validation`: parameters of agents, payload and team; their physical validity.
- `state`, `measurement`: states, inputs and forces; sensor readings.
- `aerial_manipulator`: kinematics and dynamics of one agent.
- `grasp`: contact constraints, grasp matrix, rank tests.
- `inverse_dynamics`: forces required for given accelerations.
- `actuator_lag`: delay and lag of thrust and body torque.
- `urdf`, `mjcf`: URDF import and export, MJCF export.
"""
