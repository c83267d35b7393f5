"""Transfers between particles and grid: B-spline weights, the 27-node loops, APIC.

Imports: backend, errors, materials, scene, state.
"""
