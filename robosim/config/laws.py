"""The laws of materials by the names that configuration files give them; light, so that commands list them at once."""

MATERIAL_CLASSES = {"granular": "GranularConfig", "mu_i": "MuIConfig", "fluid": "FluidConfig", "clay": "ClayConfig"}
"""Key `law` of a file of a material -> its class in `robosim.config.materials`."""
