"""The gateway: HTTP over the services."""
