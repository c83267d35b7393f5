"""Differentiable rollouts: checkpoint schedule, losses, gradients by tool motion and material.

Imports: adjoint, backend, errors, geometry, materials, observers, scene, state, stepping."""
