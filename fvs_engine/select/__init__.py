"""Choosing the next view: selectors behind one interface, and the loop of the paper's Algorithm 1."""
