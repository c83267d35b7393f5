"""Commands that simulate, and show what was simulated.

Imports: base, conversion, dosing, envs, episode, recordings, rehearsal, studies."""
