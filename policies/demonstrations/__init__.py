"""Demonstrations: generators by gradient and by search, replay, export.

Imports: learning.
"""
