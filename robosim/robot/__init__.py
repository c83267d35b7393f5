"""Arms and hands from files: assembly, inverse kinematics, timing, servo, torque sensors, ROS 2 trajectories.

Imports: base, config, mpm."""
