"""The native stages: everything here runs in the killable child process, and nothing else does."""
