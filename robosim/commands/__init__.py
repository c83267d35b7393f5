"""The command line: one file a command, in folders by their purpose, each importing what it needs when it runs.

Imports: calibration, clusters, config, conversion, dosing, envs, errors, evaluation, recordings, rehearsal, rendering,
reports, robot, robustness, tasks, tuning, verification, mpm.
"""
