"""Measuring instruments: what they show of a true value.

Imports: nothing of the project.
"""
