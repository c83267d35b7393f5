"""Verification: cases with independent reference solutions, error against run time, stability.

Imports: base, reports, mpm."""
