"""The service as processes on one machine: a supervisor, a gateway, and workers."""
