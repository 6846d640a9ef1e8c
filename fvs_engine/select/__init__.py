"""The loop of the paper's Algorithm 1: choose the next view, visit it, train, repeat."""
