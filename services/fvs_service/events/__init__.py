"""Events: what happened to a scene, in order."""
