"""Rankings: candidates in the order in which they should be photographed."""
