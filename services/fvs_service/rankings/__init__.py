"""Rankings: which of these poses should be photographed next."""
