"""Verification: cases with independent reference solutions, error against run time, stability.

Imports: config, errors, reports, verification.
"""
