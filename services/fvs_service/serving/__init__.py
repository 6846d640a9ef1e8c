"""The service as a set of processes on one machine: a supervisor, a gateway, and workers."""
