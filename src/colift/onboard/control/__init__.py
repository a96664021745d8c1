"""Control laws of payload and agents.

============================  ============================================================================
``tracking``                  geometric tracking of the payload on SE(3), desired wrench
``payload_controllers``       implementations of `PayloadController`
``allocation``                linear maps from a payload wrench to contact forces
``allocators``                linear implementation of `Allocator`
``cone_program``              solver of small cone programs with constant matrices
``constrained_allocation``    implementation of `Allocator` with limits of thrust, tilt and contact forces
``setpoints``                 setpoints of one agent
``attitude``                  attitude setpoint from the commanded thrust direction
``preview``                   attitude setpoint with rates from a preview of the reference
``redundancy``                motion of redundant joints, posture control
``realization``               inputs of one agent by inverse dynamics
``agent_controllers``         implementations of `AgentController`
``command_link``              link with delays and losses from the leader to the agents
``actuator_compensation``     implementations of `ActuatorCompensator`
``label_feedback``            stability limit of the feedback from labels to attitudes
============================  ============================================================================
"""
