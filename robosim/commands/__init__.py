"""The command line: one file a command, in folders by their purpose, each importing what it needs when it runs.

Imports: base, config, reports, robot, studies, tasks, mpm."""
