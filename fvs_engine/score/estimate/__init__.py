"""The median frequency of a view, estimated from the projected Gaussians, without a rendering."""
