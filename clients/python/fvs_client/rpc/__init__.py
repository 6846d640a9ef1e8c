"""gRPC for the client."""
