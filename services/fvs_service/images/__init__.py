"""Images: the content-addressed photographs of a scene, each with a verdict."""
