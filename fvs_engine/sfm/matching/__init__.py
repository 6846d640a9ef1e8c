"""Features, the pairs of images to match, and their matches."""
