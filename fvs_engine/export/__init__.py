"""Files of a model for other programs, in the world frame or the model's; and where on Earth they are."""
