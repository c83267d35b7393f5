"""Transfers between particles and grid: B-spline weights, the 27-node loops, APIC.

Imports: backend, materials, scene, state."""
