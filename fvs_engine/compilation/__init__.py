"""How the CPU kernels are compiled, and compiled ahead of their first use."""
