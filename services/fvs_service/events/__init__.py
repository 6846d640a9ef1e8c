"""Events: what happened to a scene, in order, for whoever watches it."""
