"""gRPC for the client: the requests of REST as calls of ``fvs.v1``. Needs the extra ``fvs-client[grpc]``."""
