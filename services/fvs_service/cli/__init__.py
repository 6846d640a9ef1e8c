"""The service's commands, added to the engine's ``fvs`` through the entry point group ``fvs.commands``."""
