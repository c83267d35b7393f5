"""What `docs/measure.py` runs: commands, pictures of their runs, and the long queues of learning."""
