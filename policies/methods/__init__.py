"""Methods of learning beyond SB3's own: cloning, adversarial imitation, evolution, planning.

Imports: demonstrations, dynamics, learning, runs.
"""
