"""The fvs service: a gateway, workers and runners around ``fvs_engine``."""
