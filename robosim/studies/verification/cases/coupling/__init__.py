"""Cases of rigid bodies coupled to a field.

Imports: config, coupling, scene, mpm."""
