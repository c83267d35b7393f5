"""The command line: one file a command, in folders by their purpose, each importing what it needs when it runs.

Imports: benchmarks, config, envs, errors, evaluation, rehearsal, rendering, robot, scene, tasks, verification, viewer, mpm.
"""
