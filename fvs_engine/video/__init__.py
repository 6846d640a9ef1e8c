"""Frames of videos as photographs, with the positions and attitudes that were recorded beside them."""
