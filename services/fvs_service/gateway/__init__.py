"""The transports: thin adapters over the same services."""
