"""Tables over runs, beside published numbers.

Imports: learning.
"""
