"""Commands that simulate, and show what was simulated.

Imports: base, conversion, dosing, envs, recordings, rehearsal, rendering, studies.
"""
