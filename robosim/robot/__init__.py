"""The arm: Pinocchio model, inverse kinematics, timing, servo, torque sensors, ROS 2 trajectories.

Imports: config, errors, scene, mpm.
"""
