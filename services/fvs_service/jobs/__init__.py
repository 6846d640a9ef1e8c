"""Jobs: queued computations on a scene, with monotone progress."""
