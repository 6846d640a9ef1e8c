"""Jobs: the long work on a scene, in a queue, with progress that never goes back."""
