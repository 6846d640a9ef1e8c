"""One scene while it grows: photographs and the Gaussians that learn from them."""
