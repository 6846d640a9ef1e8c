"""The worker on a Ray cluster: every scene has a host, an actor on the node that Ray chooses for it."""
