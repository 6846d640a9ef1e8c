"""Workers take jobs from the queue and keep one runner, a child with the warm model, per active scene."""
