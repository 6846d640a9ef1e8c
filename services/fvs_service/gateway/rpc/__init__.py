"""gRPC: the services of ``fvs.v1`` over the same application as REST."""
