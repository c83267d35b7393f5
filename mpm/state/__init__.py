"""Run-time fields: particles, nodes and active blocks, parameters, the impulse ledger, saved states.

Imports: backend, errors, materials, scene."""
