"""Learners of Stable-Baselines3 and what is added to them: demonstration buffer, actor-critics, encoders, policy files.

Imports: learning, robosim, mpm."""
