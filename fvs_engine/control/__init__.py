"""Control points: surveyed points that are marked in images, and the similarity that they determine."""
