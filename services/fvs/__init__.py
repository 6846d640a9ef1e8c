"""The Python package of the protos `fvs.v1`, generated from `proto/` by `make generate`."""
